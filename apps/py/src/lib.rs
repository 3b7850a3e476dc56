//! The Python package of Arlequin: scenes, the objects of the library, and models and solvers written in
//! Python.
//!
//! This module is thin on purpose. It converts arguments and results, keeps panics from crossing the
//! border, and releases the interpreter's lock during computations. Tables, plots and base classes are in
//! `python/arlequin`.

mod arrays;
mod border;
mod choices;
mod conformance;
mod coupled;
mod error;
mod frames;
mod matrix;
mod models;
mod plug;
mod remote;
mod scene;
mod shapes;
mod solver;
mod subdomain;
mod sweep;
mod threads;

use pyo3::prelude::*;

/// The part of the package that is written in Rust.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::border::_mistake;
    #[pymodule_export]
    use crate::choices::{
        Effect, Elastic, Junction, Ramp, Region, Shell, Slab, TimeFunction, Weights, body_force, load,
        local_damping, mass_damping, stiffness_damping,
    };
    #[pymodule_export]
    use crate::conformance::{
        forces_derive_from_energy, mass, participant, rigid_forces, shapes, symmetric_forces,
    };
    #[pymodule_export]
    use crate::coupled::{Coupled, Snapshot};
    #[pymodule_export]
    use crate::models::{ChainModel, CnemModel, DemModel, FemModel, NativeModel, Spheres};
    #[pymodule_export]
    use crate::scene::{Results, Scene, resume};
    #[pymodule_export]
    use crate::shapes::{Field, Mesh};
    #[pymodule_export]
    use crate::solver::Shares;
    #[pymodule_export]
    use crate::subdomain::{Interface, Subdomain};
    #[pymodule_export]
    use crate::sweep::sweep;
    #[pymodule_export]
    use crate::threads::{_bound_threads, _forked, set_threads};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        arlequin::core::interrupt::listen(crate::border::is_interrupted);
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
