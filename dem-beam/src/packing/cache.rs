//! Packings on disk, found again by a hash of everything that decides them.
//!
//! One file per packing, little-endian: magic, hash of the spec, hash of the content, counts,
//! numbers. A file that does not verify is made anew, so a torn write costs time, never a wrong
//! result. Files are written aside and renamed.

use super::assemble::Packing;
use super::parts::{Cut, Loose};
use super::protocol::{Compaction, PackingSpec};
use super::report::{HISTOGRAM_BINS, PackingReport};
use crate::error::{Error, Result};
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

/// Changes whenever the protocol gives other packings for the same spec.
const VERSION: f64 = 3.0;
const MAGIC: u64 = 0x414c_5144_454d_5032;

/// FNV-1a over 64-bit words, two streams for 128 bits.
fn hash(words: impl Iterator<Item = u64>) -> [u64; 2] {
    let mut h = [0xcbf2_9ce4_8422_2325_u64, 0x8422_2325_cbf2_9ce4];
    for w in words {
        for (k, h) in h.iter_mut().enumerate() {
            for byte in w.rotate_left(17 * k as u32).to_le_bytes() {
                *h = (*h ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
            }
        }
    }
    h
}

impl PackingSpec {
    /// Hash of everything that decides the packing, 32 hexadecimal digits.
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

    /// The packing from `directory` if it was made before, else made and stored there.
    ///
    /// # Errors
    /// Those of [`Self::build`]; [`Error::Io`] if the directory cannot be written.
    pub fn build_cached(&self, directory: &Path) -> Result<Packing> {
        let name = self.content_hash();
        let path = directory.join(format!("packing-{name}.bin"));
        if let Some(packing) = std::fs::read(&path).ok().and_then(|bytes| decode(&bytes)) {
            return Ok(Packing {
                period: self.container.period(),
                loose: self.loose == Loose::Keep,
                ..packing
            });
        }
        let packing = self.build()?;
        let io = |e: std::io::Error| Error::Io {
            path: path.display().to_string(),
            reason: e.to_string(),
        };
        std::fs::create_dir_all(directory).map_err(io)?;
        let aside = directory.join(format!("packing-{name}.{}.tmp", std::process::id()));
        std::fs::write(&aside, encode(&packing)).map_err(io)?;
        std::fs::rename(&aside, &path).map_err(io)?;
        Ok(packing)
    }
}

fn encode(p: &Packing) -> Vec<u8> {
    let r = &p.report;
    let mut w: Vec<u64> = vec![p.radii.len() as u64, p.pairs.len() as u64];
    w.extend([r.asked, r.placed, r.dropped, r.bodies, r.steps].map(|n| n as u64));
    w.extend(r.radius_histogram.iter().map(|&c| c as u64));
    let scalars = [
        p.volume,
        r.coordination_all,
        r.coordination_retained,
        r.coordination_interior,
        r.volume_fraction,
        r.mean_radius,
        r.radius_range[0],
        r.radius_range[1],
        r.mean_overlap,
        r.bond_tolerance,
        r.fabric_anisotropy,
        r.dropped_share,
        // No width is that of a periodic box.
        r.across.unwrap_or(-1.0),
    ];
    w.extend(scalars.iter().chain(r.fabric.iter()).map(|x| x.to_bits()));
    w.extend(
        p.positions
            .iter()
            .flat_map(|x| x.iter())
            .chain(&p.radii)
            .chain(&p.body_volumes)
            .map(|x| x.to_bits()),
    );
    w.extend(p.bodies.iter().map(|&b| u64::from(b)));
    w.extend(p.pairs.iter().map(|&[i, j]| u64::from(i) << 32 | u64::from(j)));
    let check = hash(w.iter().copied());
    [MAGIC, check[0], check[1]]
        .iter()
        .chain(&w)
        .flat_map(|x| x.to_le_bytes())
        .collect()
}

fn decode(bytes: &[u8]) -> Option<Packing> {
    let mut words = Vec::with_capacity(bytes.len() / 8);
    for c in bytes.chunks_exact(8) {
        words.push(u64::from_le_bytes(c.try_into().ok()?));
    }
    let (head, body) = words.split_at_checked(3)?;
    if head[0] != MAGIC || head[1..] != hash(body.iter().copied()) {
        return None;
    }
    let mut next = body.iter().copied();
    let mut count = || next.next().and_then(|w| usize::try_from(w).ok());
    let (spheres, bonds) = (count()?, count()?);
    let (asked, placed, dropped, bodies, steps) = (count()?, count()?, count()?, count()?, count()?);
    let mut radius_histogram = [0; HISTOGRAM_BINS];
    for c in &mut radius_histogram {
        *c = count()?;
    }
    let mut real = || next.next().map(f64::from_bits);
    let mut s = [0.0; 13];
    for x in &mut s {
        *x = real()?;
    }
    let mut fabric = Matrix3::zeros();
    for x in fabric.iter_mut() {
        *x = real()?;
    }
    let mut positions = Vec::with_capacity(spheres);
    for _ in 0..spheres {
        positions.push(Vector3::new(real()?, real()?, real()?));
    }
    let mut list = |count: usize| (0..count).map(|_| real()).collect::<Option<Vec<f64>>>();
    let (radii, body_volumes) = (list(spheres)?, list(bodies)?);
    let mut body = || next.next().and_then(|w| u32::try_from(w).ok());
    let home = (0..spheres).map(|_| body()).collect::<Option<Vec<u32>>>()?;
    let pairs: Vec<[u32; 2]> = next.map(|w| [(w >> 32) as u32, w as u32]).collect();
    if pairs.len() != bonds {
        return None;
    }
    let report = PackingReport {
        coordination_all: s[1],
        coordination_retained: s[2],
        coordination_interior: s[3],
        volume_fraction: s[4],
        mean_radius: s[5],
        radius_range: [s[6], s[7]],
        radius_histogram,
        mean_overlap: s[8],
        bond_tolerance: s[9],
        fabric,
        fabric_anisotropy: s[10],
        asked,
        placed,
        dropped,
        dropped_share: s[11],
        bodies,
        across: (s[12] >= 0.0).then_some(s[12]),
        cut: Cut::default(),
        steps,
    };
    Some(Packing {
        positions,
        radii,
        pairs,
        bodies: home,
        body_volumes,
        volume: s[0],
        period: None,
        loose: false,
        report,
    })
}
