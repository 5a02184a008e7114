//! `retarget._solver`: kinematics, strict hierarchies, whole frames, and filters for streams of poses. It uses no file, no clock and no
//! servo. `use` runs one way between the files here (`tests/test_arrows_rust.py`).

pub mod body; // links and joints
pub mod braking; // how far a coordinate may go in one frame, and how joints come to rest
mod converge; // one frame: the convergence loop, its linear problems; many frames in a row
pub mod frame; // the state of a solver of frames
pub mod geometry; // solids and the distance between them
pub mod hierarchy; // strict levels of linear tasks
pub mod kinematics; // poses of links, and Jacobians
mod level_rows; // the rows of the problem that each level and each of its tasks has
pub mod math; // vectors, quaternions, matrices
pub mod observers; // observers, obstacles, their rows; paths
#[cfg(feature = "python")]
pub mod python; // the bindings of all but the streams
pub mod streams; // poses of sensors as they come in
pub mod task; // errors of the tasks of a body
pub mod task_rows; // Jacobian rows of one task
#[cfg(test)]
mod tests; // against closed forms and optimality conditions
pub mod trajectory; // slow moves in joint space

#[cfg(feature = "python")]
#[pyo3::pymodule]
fn _solver(m: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
    python::register(m)?;
    streams::python::register(m)
}
