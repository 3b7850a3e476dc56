//! Placeholder bench entry.
fn main() {}
