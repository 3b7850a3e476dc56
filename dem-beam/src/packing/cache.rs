//! Cache of packings on disk, by a hash of everything that determines them.
//!
//! There is one little-endian file per packing: magic number, hash of the content, counts, numbers. Its name
//! has the hash of the spec. A file that does not verify is made anew, so that an incomplete write costs time
//! but never gives a wrong result. Files are written under another name and then renamed.

use super::assemble::Packing;
use super::bonding::Loose;
use super::protocol::{Compaction, PackingSpec};
use crate::error::Result;
use nalgebra::Vector3;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Version of the protocol, to be raised whenever it gives other packings for the same spec.
const VERSION: f64 = 5.0;
const MAGIC: u64 = 0x414c_5144_454d_5032;

/// Returns the FNV-1a hash of 64-bit words, in two streams for 128 bits.
fn hash(words: impl Iterator<Item = u64>) -> [u64; 2] {
    let mut h = [0xcbf2_9ce4_8422_2325_u64, 0x8422_2325_cbf2_9ce4];
    for w in words {
        for (k, h) in h.iter_mut().enumerate() {
            // Rotated words make the second stream differ from the first.
            for byte in w.rotate_left(17 * k as u32).to_le_bytes() {
                *h = (*h ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
    }
    h
}

impl PackingSpec {
    /// Returns the hash of everything that determines the packing, as 32 hexadecimal digits.
    #[must_use]
    pub fn content_hash(&self) -> String {
        let mut x = vec![VERSION, self.count as f64, self.spread, self.coordination];
        x.push(self.max_steps as f64);
        match self.compaction {
            Compaction::Onset { overlap } => x.extend([1.0, overlap]),
            Compaction::Quench { fraction } => x.extend([2.0, fraction]),
        }
        match self.loose {
            Loose::Drop { limit } => x.extend([1.0, limit]),
            Loose::Keep => x.push(2.0),
        }
        self.container.identity(&mut x);
        let words = x.iter().map(|v| v.to_bits()).chain([self.seed]);
        let h = hash(words);
        format!("{:016x}{:016x}", h[0], h[1])
    }

    /// Reads the packing from `directory`, or makes it and stores it there if the directory can be written.
    ///
    /// # Errors
    /// Errors of [`Self::build`].
    pub fn build_cached(&self, directory: &Path) -> Result<Packing> {
        self.build_cached_with(directory, &mut |_| ())
    }

    /// Does what [`Self::build_cached`] does; `progress` is that of [`Self::build_with`].
    ///
    /// # Errors
    /// Errors of [`Self::build`].
    pub fn build_cached_with(&self, directory: &Path, progress: &mut dyn FnMut(f64)) -> Result<Packing> {
        let name = self.content_hash();
        let path = directory.join(format!("packing-{name}.bin"));
        if let Some(packing) = std::fs::read(&path).ok().and_then(|bytes| decode(&bytes)) {
            // The spec determines these two, so that the file does not have them.
            return Ok(Packing {
                period: self.container.period(),
                loose: self.loose == Loose::Keep,
                ..packing
            });
        }
        let packing = self.build_with(progress)?;
        // If the folder cannot be written the packing is still right; the next run makes it again.
        let _ = store(&packing, directory, &path);
        Ok(packing)
    }
}

/// Writes a packing completely or not at all. Processes and threads that make the same packing write to
/// different temporary files.
fn store(packing: &Packing, directory: &Path, path: &Path) -> std::io::Result<()> {
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    std::fs::create_dir_all(directory)?;
    let unique = format!("{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let aside = path.with_extension(format!("{unique}.tmp"));
    std::fs::write(&aside, encode(packing))
        .and_then(|()| std::fs::rename(&aside, path))
        .inspect_err(|_| {
            let _ = std::fs::remove_file(&aside);
        })
}

/// Passes every number of a packing through `word`, which reads or writes it, so that reading and writing
/// share one order. Returns `None` if there are too few words, or a word does not fit.
fn for_each_word(p: &mut Packing, word: &mut dyn FnMut(u64) -> Option<u64>) -> Option<()> {
    let r = &mut p.report;
    let (mut spheres, mut bonds) = (p.radii.len(), p.pairs.len());
    let counts = [
        &mut spheres,
        &mut bonds,
        &mut r.asked,
        &mut r.placed,
        &mut r.dropped,
        &mut r.beyond,
        &mut r.bodies,
        &mut r.steps,
    ];
    for n in counts.into_iter().chain(&mut r.radius_histogram) {
        *n = usize::try_from(word(*n as u64)?).ok()?;
    }
    p.positions.resize(spheres, Vector3::zeros());
    p.radii.resize(spheres, 0.0);
    p.bodies.resize(spheres, 0);
    p.body_volumes.resize(r.bodies, 0.0);
    p.pairs.resize(bonds, [0; 2]);
    // A periodic box has no width; -1 stands for it.
    let mut across = r.across.unwrap_or(-1.0);
    let [smallest, largest] = &mut r.radius_range;
    let scalars = [
        &mut p.volume,
        &mut r.coordination_all,
        &mut r.coordination_retained,
        &mut r.coordination_interior,
        &mut r.volume_fraction,
        &mut r.mean_radius,
        smallest,
        largest,
        &mut r.mean_overlap,
        &mut r.bond_tolerance,
        &mut r.fabric_anisotropy,
        &mut r.dropped_share,
        &mut across,
    ];
    let positions = p.positions.iter_mut().flat_map(|x| x.iter_mut());
    let numbers = scalars.into_iter().chain(r.fabric.iter_mut()).chain(positions);
    for x in numbers.chain(&mut p.radii).chain(&mut p.body_volumes) {
        *x = f64::from_bits(word(x.to_bits())?);
    }
    r.across = (across >= 0.0).then_some(across);
    for b in &mut p.bodies {
        *b = u32::try_from(word(u64::from(*b))?).ok()?;
    }
    for pair in &mut p.pairs {
        let packed = word(u64::from(pair[0]) << 32 | u64::from(pair[1]))?;
        *pair = [(packed >> 32) as u32, packed as u32];
    }
    Some(())
}

fn encode(p: &Packing) -> Vec<u8> {
    let mut numbers: Vec<u64> = Vec::new();
    let done = for_each_word(&mut p.clone(), &mut |w| {
        numbers.push(w);
        Some(w)
    });
    debug_assert!(done.is_some(), "numbers of a packing fit into words");
    let check = hash(numbers.iter().copied());
    let head = [MAGIC, check[0], check[1]];
    head.iter()
        .chain(&numbers)
        .flat_map(|x| x.to_le_bytes())
        .collect()
}

fn decode(bytes: &[u8]) -> Option<Packing> {
    let (chunks, _) = bytes.as_chunks::<8>();
    let chunks: Vec<u64> = chunks.iter().map(|c| u64::from_le_bytes(*c)).collect();
    let (head, body) = chunks.split_at_checked(3)?;
    if head[0] != MAGIC || head[1..] != hash(body.iter().copied()) {
        return None;
    }
    // The hash has been verified, so that the counts in the file can be trusted.
    let mut packing = Packing::default();
    let mut next = body.iter().copied();
    for_each_word(&mut packing, &mut |_| next.next())?;
    next.next().is_none().then_some(packing)
}
