//! Feeds mutated files to a reader, for the tests of crates with readers: no panic, no hang, bounded
//! allocation.
//!
//! Seeds are the files of a corpus folder. Mutations change bytes, lines, tokens and numbers, and insert
//! parts of one file into another. Some hundred cases run in every test; `ARLEQUIN_FUZZ_SECONDS=3600` runs
//! that long with new random numbers. proptest shrinks and prints a failing file, which belongs into the
//! corpus.
//!
//! [`property_config`] is the configuration of every property test of the workspace.

mod property;

pub use property::property_config;
#[doc(hidden)]
pub use stats_alloc;

use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

/// Number of cases of an ordinary test, and of one round of a long one.
const CASES: u32 = 2000;
/// Time that no small file may take, even on a busy machine.
const SLOW: Duration = Duration::from_secs(10);

/// Numbers that break naive readers.
const NUMBERS: [&str; 18] = [
    "0",
    "1",
    "2",
    "-1",
    "4",
    "0.5",
    "1e12",
    "1000000000000",
    "4294967295",
    "4294967296",
    "2147483648",
    "18446744073709551615",
    "-9223372036854775808",
    "1e999",
    "nan",
    "inf",
    "1e-320",
    "",
];
const BINARY: [u64; 8] = [
    0,
    1,
    0xffff,
    0x7fff_ffff,
    0xffff_ffff,
    1 << 40,
    u64::MAX,
    0x7ff8_0000_0000_0000,
];

#[derive(Debug, Clone)]
enum Mutation {
    Byte(Index, u8),
    Cut(Index, u8),
    Repeat(Index, u8, u8),
    DropLine(Index),
    CopyLine(Index, Index),
    SwapLines(Index, Index),
    Number(Index, Index),
    Binary(Index, Index, bool),
    Token(Index, Index),
    Splice(Index, Index, Index),
    Truncate(Index),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    use Mutation::*;
    let index = any::<Index>;
    prop_oneof![
        3 => (index(), any::<u8>()).prop_map(|(i, b)| Byte(i, b)),
        2 => (index(), any::<u8>()).prop_map(|(i, n)| Cut(i, n)),
        1 => (index(), any::<u8>(), 1..8u8).prop_map(|(i, n, k)| Repeat(i, n, k)),
        3 => index().prop_map(DropLine),
        2 => (index(), index()).prop_map(|(i, j)| CopyLine(i, j)),
        2 => (index(), index()).prop_map(|(i, j)| SwapLines(i, j)),
        6 => (index(), index()).prop_map(|(i, n)| Number(i, n)),
        2 => (index(), index(), any::<bool>()).prop_map(|(i, n, wide)| Binary(i, n, wide)),
        3 => (index(), index()).prop_map(|(i, n)| Token(i, n)),
        1 => (index(), index(), index()).prop_map(|(s, i, j)| Splice(s, i, j)),
        1 => index().prop_map(Truncate),
    ]
}

fn lines(text: &[u8]) -> Vec<Vec<u8>> {
    text.split_inclusive(|b| *b == b'\n')
        .map(<[u8]>::to_vec)
        .collect()
}

/// Returns the ranges of bytes that look like numbers.
fn numbers(text: &[u8]) -> Vec<std::ops::Range<usize>> {
    let part = |b: &u8| b.is_ascii_digit() || b"+-.eE".contains(b);
    let (mut out, mut k) = (Vec::new(), 0);
    while k < text.len() {
        let n = text[k..].iter().take_while(|b| part(b)).count();
        if text[k..k + n].iter().any(u8::is_ascii_digit) {
            out.push(k..k + n);
        }
        k += n.max(1);
    }
    out
}

impl Mutation {
    fn apply(&self, text: &mut Vec<u8>, corpus: &Corpus) {
        if text.is_empty() {
            return;
        }
        let n = text.len();
        match self {
            Self::Byte(i, b) => text[i.index(n)] = *b,
            Self::Cut(i, k) => {
                let i = i.index(n);
                text.drain(i..n.min(i + usize::from(*k)));
            }
            Self::Repeat(i, k, times) => {
                let i = i.index(n);
                let piece = text[i..n.min(i + usize::from(*k))].repeat(usize::from(*times));
                text.splice(i..i, piece);
            }
            Self::DropLine(i) => with_lines(text, |l| {
                l.remove(i.index(l.len()));
            }),
            Self::CopyLine(i, j) => with_lines(text, |l| {
                let line = l[i.index(l.len())].clone();
                l.insert(j.index(l.len()), line);
            }),
            Self::SwapLines(i, j) => with_lines(text, |l| {
                let n = l.len();
                l.swap(i.index(n), j.index(n));
            }),
            Self::Number(i, with) => {
                let ranges = numbers(text);
                if !ranges.is_empty() {
                    let new = NUMBERS[with.index(NUMBERS.len())];
                    text.splice(ranges[i.index(ranges.len())].clone(), new.bytes());
                }
            }
            Self::Binary(i, with, wide) => {
                let raw = BINARY[with.index(BINARY.len())].to_le_bytes();
                let i = i.index(n);
                let width = if *wide { 8 } else { 4 }.min(n - i);
                text[i..i + width].copy_from_slice(&raw[..width]);
            }
            Self::Token(i, with) => {
                let token = corpus.tokens[with.index(corpus.tokens.len())];
                let i = i.index(n);
                text.splice(i..i, token.bytes());
            }
            Self::Splice(seed, i, j) => {
                let donor = &corpus.seeds[seed.index(corpus.seeds.len())];
                if !donor.is_empty() {
                    text.truncate(i.index(n));
                    text.extend_from_slice(&donor[j.index(donor.len())..]);
                }
            }
            Self::Truncate(i) => text.truncate(i.index(n)),
        }
    }
}

fn with_lines(text: &mut Vec<u8>, change: impl FnOnce(&mut Vec<Vec<u8>>)) {
    let mut split = lines(text);
    change(&mut split);
    *text = split.concat();
}

/// Seeds to mutate, and the memory that a reader may allocate.
#[derive(Debug)]
pub struct Corpus {
    /// Whole files to mutate.
    pub seeds: Vec<Vec<u8>>,
    /// Words of the format.
    pub tokens: &'static [&'static str],
    /// Bytes that a reader may allocate in total for any file.
    pub floor: usize,
    /// Bytes that a reader may allocate in addition per byte of the file.
    pub per_byte: usize,
}

impl Corpus {
    /// Returns all files of a folder with the given ending, sorted by name.
    pub fn read(folder: &str, ending: &str) -> Vec<Vec<u8>> {
        let mut paths: Vec<_> = std::fs::read_dir(folder)
            .unwrap_or_else(|e| panic!("{folder}: {e}"))
            .map(|f| f.unwrap_or_else(|e| panic!("{folder}: {e}")).path())
            .filter(|p| p.extension().is_some_and(|e| e == ending))
            .collect();
        paths.sort();
        assert!(!paths.is_empty(), "{folder} holds no .{ending}");
        paths
            .iter()
            .map(|p| std::fs::read(p).unwrap_or_else(|e| panic!("{}: {e}", p.display())))
            .collect()
    }

    /// Feeds mutants to a reader, which returns whether it accepted them. `allocated` counts the bytes since
    /// the start of the process.
    pub fn run(&self, name: &str, allocated: &dyn Fn() -> usize, reader: &dyn Fn(&[u8]) -> bool) {
        let seconds = std::env::var("ARLEQUIN_FUZZ_SECONDS").ok();
        let seconds = seconds.map(|s| {
            s.parse::<u64>()
                .unwrap_or_else(|e| panic!("ARLEQUIN_FUZZ_SECONDS: {e}"))
        });
        let (begin, counts) = (Instant::now(), [AtomicUsize::new(0), AtomicUsize::new(0)]);
        let worst = AtomicUsize::new(0);
        let dog = Watchdog::new();
        let execute = |bytes: &[u8]| {
            dog.pat();
            let bound = self.floor + self.per_byte * bytes.len();
            let measure = || {
                let (start, before) = (Instant::now(), allocated());
                let accepted = reader(bytes);
                (accepted, start.elapsed(), allocated() - before)
            };
            let (accepted, mut took, mut used) = measure();
            // Other tests of the process may have allocated meanwhile.
            for _ in 0..4 {
                if used <= bound && took < SLOW {
                    break;
                }
                let repeated = measure();
                (took, used) = (took.min(repeated.1), used.min(repeated.2));
            }
            assert!(
                used <= bound,
                "{used} bytes allocated for a file of {}, bound {bound}",
                bytes.len()
            );
            assert!(took < SLOW, "took {took:?}");
            worst.fetch_max(1000 * used / bound, Ordering::Relaxed);
            counts[0].fetch_add(1, Ordering::Relaxed);
            counts[1].fetch_add(usize::from(accepted), Ordering::Relaxed);
        };
        self.seeds.iter().for_each(|s| execute(s));
        for round in 0u64.. {
            let mut seed = [0; 32];
            seed[..8].copy_from_slice(&round.to_le_bytes());
            if round > 0 {
                let now = std::time::SystemTime::UNIX_EPOCH
                    .elapsed()
                    .map_or(0, |d| d.as_nanos() as u64);
                seed[8..16].copy_from_slice(&now.to_le_bytes());
            }
            let config = Config {
                cases: CASES,
                failure_persistence: None,
                ..Config::default()
            };
            let mut runner =
                TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &seed));
            let strategy = (any::<Index>(), prop::collection::vec(mutation(), 1..6));
            let done = runner.run(&strategy, |(seed, mutations)| {
                let mut text = self.seeds[seed.index(self.seeds.len())].clone();
                mutations.iter().for_each(|m| m.apply(&mut text, self));
                execute(&text);
                Ok(())
            });
            done.unwrap_or_else(|e| panic!("{name}: {e}"));
            if seconds.is_none_or(|s| begin.elapsed() >= Duration::from_secs(s)) {
                break;
            }
        }
        let [executions, accepted] = counts.map(AtomicUsize::into_inner);
        assert!(
            accepted > 0,
            "{name}: not even one of {executions} files was accepted"
        );
        #[allow(clippy::print_stdout, reason = "the number of executions of a long run")]
        {
            let worst = worst.into_inner() as f64 / 10.0;
            println!(
                "{name}: {executions} executions, {accepted} accepted, at most {worst} % of the allocation bound, {:?}",
                begin.elapsed()
            );
        }
    }
}

/// Ends the process if a case hangs.
struct Watchdog(std::sync::Arc<AtomicU64>);

impl Watchdog {
    fn new() -> Self {
        let beat = std::sync::Arc::new(AtomicU64::new(0));
        let weak = std::sync::Arc::downgrade(&beat);
        std::thread::spawn(move || {
            let mut last = u64::MAX;
            // One check per minute is enough, since a case takes milliseconds.
            while let Some(now) = weak.upgrade().map(|b| b.load(Ordering::Relaxed)) {
                if now == last {
                    #[allow(clippy::print_stderr, reason = "the last word before the abort")]
                    {
                        eprintln!("case {now} hangs");
                    }
                    std::process::abort();
                }
                last = now;
                std::thread::sleep(Duration::from_secs(60));
            }
        });
        Self(beat)
    }

    fn pat(&self) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// Declares the allocator of a test file for a reader: `allocated()` counts the bytes that the whole process
/// has requested, so that the file's tests lock `ALONE` to run one after the other.
#[macro_export]
macro_rules! counted {
    () => {
        #[global_allocator]
        static GLOBAL: &$crate::stats_alloc::StatsAlloc<std::alloc::System> =
            &$crate::stats_alloc::INSTRUMENTED_SYSTEM;

        static ALONE: std::sync::Mutex<()> = std::sync::Mutex::new(());

        fn allocated() -> usize {
            GLOBAL.stats().bytes_allocated
        }
    };
}
