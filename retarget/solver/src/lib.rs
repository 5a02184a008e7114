//! retarget._solver: kinematics, strict hierarchies, whole frames, poses as they are heard. Knows no file, no clock, no servo.

mod allocations;
mod assemble;
mod avoid;
pub mod body;
pub mod bounds;
pub mod braking;
mod clip;
pub mod frame;
pub mod geometry;
pub mod hierarchy;
pub mod kinematics;
pub mod last_poses;
mod layout;
pub mod math;
pub mod observers;
pub mod playout;
mod progress;
mod py_arrays;
mod py_body;
mod py_bounds;
mod py_braking;
mod py_hierarchy;
mod py_observers;
mod py_path;
mod py_playout;
mod py_probe;
mod py_sensor_plan;
mod py_shapes;
mod py_smooth;
mod py_solver;
mod py_task;
mod py_watched;
pub mod rows;
pub mod sensor_plan;
pub mod smooth;
pub mod sound;
pub mod stillness;
pub mod task;
pub mod watched;

use pyo3::prelude::*;

#[pymodule]
fn _solver(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<py_body::PyBody>()?;
    m.add_class::<py_task::PyTask>()?;
    m.add_class::<py_probe::PyProbe>()?;
    m.add_class::<py_probe::PyFooting>()?;
    m.add_class::<py_braking::PyBraking>()?;
    m.add_class::<py_observers::PyObservers>()?;
    m.add_class::<py_path::PyPathChecker>()?;
    m.add_class::<py_solver::PySolver>()?;
    m.add_class::<py_hierarchy::HierarchyResult>()?;
    m.add_function(wrap_pyfunction!(py_hierarchy::solve_hierarchy, m)?)?;
    m.add_function(wrap_pyfunction!(py_bounds::frame_bounds, m)?)?;
    m.add_function(wrap_pyfunction!(py_shapes::shape_distances, m)?)?;
    m.add_class::<py_smooth::PyPoseFilter>()?;
    m.add_function(wrap_pyfunction!(py_smooth::along_arc, m)?)?;
    m.add_class::<py_playout::PyPoseRing>()?;
    m.add_class::<py_sensor_plan::PySensorPlan>()?;
    m.add_class::<py_sensor_plan::PyPoseParts>()?;
    m.add_class::<py_watched::PyWatchedSensors>()?;
    m.add_function(wrap_pyfunction!(py_shapes::shape_gaps_at_least, m)?)?;
    Ok(())
}
