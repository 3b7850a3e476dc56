//! Checkpoints: everything a run needs to continue bit for bit, in one file that is either complete or
//! absent.
//!
//! ```text
//! "ARLQCKPT"   format, u32   length of the payload, u64   payload (postcard)   CRC-32 of all before, u32
//! ```
//!
//! Numbers are little-endian. The file is written under a temporary name, synced and renamed: whenever the
//! program dies, the last complete checkpoint remains. The payload holds the text of the scene, so that a
//! resumed run uses the same scene, and check sums of the files that the scene reads.

use super::follow::Followed;
use super::origin::Origin;
use super::recorder::Records;
use crate::error::{Error, Result, write};
use crate::output::mark::{self, CHECKPOINT};
use arlequin::core::snapshot::Snapshot;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Write as _;
use std::path::Path;

/// Format number; to be increased whenever the payload changes.
const FORMAT: u32 = 11;
const MAGIC: &[u8; 8] = b"ARLQCKPT";
const HEAD: usize = 8 + 4 + 8;
const TAIL: usize = 4;

/// A run at one instant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Checkpoint {
    /// Version of the program.
    pub version: String,
    /// Scene of the run.
    pub origin: Origin,
    /// State of the models.
    pub snapshot: Snapshot<f64>,
    /// Probes, energies and frames recorded so far.
    pub records: Records,
    /// Zone that follows; `None` without one.
    pub follow: Option<Followed>,
}

/// Removes the checkpoint of a run that is complete.
pub(crate) fn remove(folder: &Path) -> Result<()> {
    let path = folder.join(CHECKPOINT);
    if path.exists() {
        std::fs::remove_file(&path).map_err(write(&path))?;
    }
    Ok(())
}

impl Checkpoint {
    /// Writes the checkpoint into a folder and replaces an older one.
    pub(crate) fn write(&self, folder: &Path) -> Result<()> {
        let bytes = self.encode().map_err(|e| Error::System {
            what: "packing the checkpoint",
            message: e.to_string(),
        })?;
        let path = folder.join(CHECKPOINT);
        let aside = folder.join(format!("{CHECKPOINT}.tmp"));
        let put = || -> std::io::Result<()> {
            let mut file = File::create(&aside)?;
            file.write_all(&bytes)?;
            // The content must be on disk before the name refers to it.
            file.sync_all()?;
            std::fs::rename(&aside, &path)?;
            // The rename itself must survive a power failure; not every system can sync a folder.
            if let Ok(folder) = File::open(folder) {
                let _ = folder.sync_all();
            }
            Ok(())
        };
        put().map_err(write(&path))
    }

    /// Reads the checkpoint of a folder.
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let path = folder.join(CHECKPOINT);
        // A summary without a checkpoint is that of a run that has ended.
        let bytes = std::fs::read(&path).map_err(|source| match folder.join(mark::SUMMARY).exists() {
            true if source.kind() == std::io::ErrorKind::NotFound => Error::Checkpoint {
                path: folder.to_owned(),
                reason: "has a run that has ended, and no checkpoint to go on from; run its scene anew, to a later end if \
                         that is what is missing"
                    .into(),
            },
            false if source.kind() == std::io::ErrorKind::NotFound => Error::Checkpoint {
                path: folder.to_owned(),
                reason: "has no checkpoint.bin to go on from; name the folder of a run that was interrupted, or start its \
                         scene anew with arlequin run"
                    .into(),
            },
            _ => Error::Read {
                path: path.clone(),
                source,
            },
        })?;
        Self::decode(&bytes).map_err(|reason| Error::Checkpoint { path, reason })
    }

    fn encode(&self) -> postcard::Result<Vec<u8>> {
        let payload = postcard::to_allocvec(self)?;
        let mut out = Vec::with_capacity(HEAD + payload.len() + TAIL);
        out.extend(MAGIC);
        out.extend(FORMAT.to_le_bytes());
        out.extend((payload.len() as u64).to_le_bytes());
        out.extend(payload);
        out.extend(crc32fast::hash(&out).to_le_bytes());
        Ok(out)
    }

    /// Undoes [`Self::encode`]; `Err` holds the reason and the remedy.
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        if bytes.get(..8) != Some(MAGIC) {
            return Err("is no checkpoint of this program".into());
        }
        // The order of the checks decides the message: a file cut short is reported as truncated, not as
        // damaged.
        let truncated = || {
            let length = bytes.len();
            format!("is truncated at {length} bytes; take another copy, or start the run anew")
        };
        let format = word(bytes, 8).ok_or_else(truncated)?;
        if format != FORMAT {
            return Err(format!(
                "has format {format}, this program reads format {FORMAT}; resume it with the version that wrote it"
            ));
        }
        let low = u64::from(word(bytes, 12).ok_or_else(truncated)?);
        let high = u64::from(word(bytes, 16).ok_or_else(truncated)?);
        let length = usize::try_from(low | (high << 32)).map_err(|_| truncated())?;
        // The length comes from the file: the sum could overflow.
        let end = HEAD.checked_add(length).ok_or_else(truncated)?;
        let sum = word(bytes, end).ok_or_else(truncated)?;
        if bytes.len() != end + TAIL {
            return Err(format!(
                "has {} bytes too many; take another copy",
                bytes.len() - end - TAIL
            ));
        }
        if sum != crc32fast::hash(&bytes[..end]) {
            return Err(
                "is damaged: its check sum does not fit; take another copy, or start the run anew".into(),
            );
        }
        postcard::from_bytes(&bytes[HEAD..end])
            .map_err(|e| format!("cannot be understood ({e}); resume it with the version that wrote it"))
    }
}

fn word(bytes: &[u8], offset: usize) -> Option<u32> {
    let four = bytes.get(offset..offset.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use arlequin::core::Warning;
    use arlequin::core::snapshot::{PairSnapshot, Record, RezoningSnapshot, SubdomainSnapshot};
    use proptest::prelude::*;

    fn sample() -> Checkpoint {
        let body = SubdomainSnapshot {
            q: vec![1.0, -2.5e-300],
            v: vec![0.1, f64::MIN_POSITIVE],
            a: vec![0.0, -0.0],
            internal: vec![3.0, 4.0],
            energy: Some(2.5),
            works: vec![7.0],
            evolved: Some(-1.0),
            model: Record {
                numbers: vec![0.5],
                integers: vec![u64::MAX, 3],
            },
            effects: vec![Record::default()],
        };
        Checkpoint {
            version: "0".into(),
            origin: Origin {
                path: "a.toml".into(),
                folder: "/tmp".into(),
                text: "[time]\nend = 1.0".into(),
                set: vec!["time.end=2".into()],
                files: vec![("m.msh".into(), 3, 17)],
            },
            snapshot: Snapshot {
                step: 12,
                dt: 1e-9,
                start_loss: 0.0,
                ledger: vec![0.0; 10],
                subdomains: vec![body],
                own_steps: vec![1],
                impulses: vec![vec![1.0, 2.0]],
                pairs: vec![PairSnapshot {
                    work: -0.5,
                    effect: Record::default(),
                }],
                warnings: vec![Warning::EnergyUnknown { model: "fine".into() }],
                rezoning: Some(RezoningSnapshot {
                    count: 3,
                    works: [0.5, -1.0, 0.0, 2.0],
                    weights: u64::MAX,
                }),
            },
            records: Records::default(),
            follow: None,
        }
    }

    /// Repairs length and check sum, so that the test reaches the decoder behind them.
    fn sealed(mut body: Vec<u8>) -> Vec<u8> {
        body.truncate(body.len().saturating_sub(TAIL));
        let length = (body.len().saturating_sub(HEAD) as u64).to_le_bytes();
        if body.len() >= HEAD {
            body[12..HEAD].copy_from_slice(&length);
        }
        let sum = crc32fast::hash(&body);
        body.extend(sum.to_le_bytes());
        body
    }

    #[test]
    fn what_is_written_is_read() {
        let c = sample();
        assert_eq!(Checkpoint::decode(&c.encode().unwrap()).unwrap(), c);
    }

    #[test]
    fn reasons_are_named() {
        let good = sample().encode().unwrap();
        let reason = |b: &[u8]| Checkpoint::decode(b).unwrap_err();
        assert_eq!(reason(b""), "is no checkpoint of this program");
        assert_eq!(
            reason(b"PK\x03\x04 something else"),
            "is no checkpoint of this program"
        );
        for n in 8..good.len() {
            let r = reason(&good[..n]);
            assert!(r.starts_with("is truncated at"), "{n}: {r}");
        }
        let mut newer = good.clone();
        newer[8] = 12;
        let message = format!("has format 12, this program reads format {FORMAT}");
        assert!(reason(&newer).starts_with(&message));
        for k in (HEAD..good.len()).step_by(7) {
            let mut bad = good.clone();
            bad[k] ^= 0x10;
            assert!(reason(&bad).starts_with("is damaged"), "byte {k}");
        }
        let mut long = good.clone();
        long.push(0);
        assert_eq!(reason(&long), "has 1 bytes too many; take another copy");
    }

    proptest! {
        #![proptest_config(reader_fuzz::property_config(2000))]

        /// Arbitrary bytes neither crash the decoder nor make it allocate more than a few times their length.
        #[test]
        fn any_bytes_are_an_error_or_a_checkpoint(
            offset in 0usize..400, noise in proptest::collection::vec(any::<u8>(), 1..40), cut in 0usize..400,
        ) {
            let mut bytes = sample().encode().unwrap();
            let start = offset.min(bytes.len() - 1).max(HEAD);
            let end = (start + noise.len()).min(bytes.len());
            bytes[start..end].copy_from_slice(&noise[..end - start]);
            bytes.truncate(bytes.len().saturating_sub(cut).max(HEAD + TAIL));
            if let Ok(c) = Checkpoint::decode(&sealed(bytes)) {
                prop_assert!(c.snapshot.subdomains.len() < 400);
            }
        }

        #[test]
        fn random_bytes_are_refused(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            prop_assert!(Checkpoint::decode(&bytes).is_err());
            let with_magic = [&MAGIC[..], &FORMAT.to_le_bytes(), &bytes].concat();
            let _ = Checkpoint::decode(&sealed(with_magic));
        }
    }
}
