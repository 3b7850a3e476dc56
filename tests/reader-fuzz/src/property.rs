//! Random numbers of the workspace's property tests.

use proptest::test_runner::{Config, RngSeed};

/// Seed of all property tests, unless `PROPTEST_RNG_SEED` gives another one.
const SEED: u64 = 20_261_122;

/// Returns the configuration of a property test with this number of cases: it draws from a fixed seed, so
/// that `cargo test` gives the same result each time it runs on the same source.
///
/// `PROPTEST_RNG_SEED`, which `.ci/draw` sets, replaces the seed. Every `proptest!` block begins with
/// `#![proptest_config(reader_fuzz::property_config(64))]`; a test of this crate looks for blocks that do
/// not.
pub fn property_config(cases: u32) -> Config {
    let config = Config::with_cases(cases);
    let rng_seed = match config.rng_seed {
        RngSeed::Random => RngSeed::Fixed(SEED),
        from_environment @ RngSeed::Fixed(_) => from_environment,
    };
    Config { rng_seed, ..config }
}
