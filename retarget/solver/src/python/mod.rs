//! Python bindings of the solver, one file for each class. Arrays are checked here, and nowhere below. `retarget/_solver.pyi` documents
//! all names.

mod arithmetic;
pub mod arrays;
mod body;
mod braking;
mod observers;
mod path;
mod shapes;
mod solver;
mod task;
mod trajectory;

use pyo3::prelude::*;

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<body::PyBody>()?;
    m.add_class::<task::PyTask>()?;
    m.add_class::<body::PyProbe>()?;
    m.add_class::<body::PyFooting>()?;
    m.add_class::<braking::PyBraking>()?;
    m.add_class::<trajectory::PyTrajectoryGenerator>()?;
    m.add_class::<observers::PyObservers>()?;
    m.add_class::<path::PyPathChecker>()?;
    m.add_class::<solver::PySolver>()?;
    m.add_function(wrap_pyfunction!(solver::solve_hierarchy, m)?)?;
    m.add_function(wrap_pyfunction!(braking::braking_displacement, m)?)?;
    m.add_function(wrap_pyfunction!(shapes::shape_distances, m)?)?;
    m.add_function(wrap_pyfunction!(shapes::shape_gaps_at_least, m)?)?;
    m.add("MASS_BRAKING", crate::braking::MASS_BRAKING)?;
    arithmetic::register(m)
}
