//! Internal forces: assembled 3 × 3 blocks against the matrix-free element loop.

fn main() {
    divan::main();
}
