//! The Python package of Arlequin: scenes, the objects of the library, and models and solvers written in Python.
//!
//! Thin on purpose: this module turns arguments and results into one another's language and keeps the border tight (no
//! panic, no lock of the interpreter during a computation); tables, plots and base classes are in `python/arlequin`.

mod arrays;
mod border;
mod error;
mod frames;
mod scene;
mod sweep;

use pyo3::prelude::*;

/// The part of the package that is written in Rust.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::scene::{Results, Scene, resume};
    #[pymodule_export]
    use crate::sweep::{set_threads, sweep};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
