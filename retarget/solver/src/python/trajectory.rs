//! `TrajectoryGenerator` for Python.

use super::arrays::{bad, vector, vector_or_zeros, Numbers, Vector};
use crate::trajectory::{MotionLimit, TrajectoryGenerator};
use numpy::PyArray1;
use pyo3::prelude::*;

/// Largest state of a joint, rad, rad/s and rad/s^2. A greater number is an error of the caller.
const LARGEST: f64 = 1e6;

/// See `retarget/_solver.pyi`.
#[pyclass(name = "TrajectoryGenerator", module = "retarget._solver")]
pub struct PyTrajectoryGenerator {
    generator: TrajectoryGenerator,
}

#[pymethods]
impl PyTrajectoryGenerator {
    #[new]
    #[pyo3(signature = (max_velocity, max_acceleration, max_jerk, *, dt))]
    fn new(max_velocity: Numbers<'_>, max_acceleration: Numbers<'_>, max_jerk: Numbers<'_>, dt: f64) -> PyResult<Self> {
        let n = max_velocity.as_slice()?.len();
        let velocity = vector(&max_velocity, n, "max_velocity")?;
        let acceleration = vector(&max_acceleration, n, "max_acceleration")?;
        let jerk = vector(&max_jerk, n, "max_jerk")?;
        let all = [velocity, acceleration, jerk, &[dt]].concat();
        if n == 0 || !dt.is_finite() || all.iter().any(|v| !(*v > 0.0)) {
            return Err(bad("max_velocity, max_acceleration, max_jerk and dt must be given and positive".into()));
        }
        let limit = |i| MotionLimit { velocity: velocity[i], acceleration: acceleration[i], jerk: jerk[i] };
        Ok(Self { generator: TrajectoryGenerator::new((0..n).map(limit).collect(), dt).map_err(bad)? })
    }

    #[pyo3(signature = (position, velocity=None, acceleration=None))]
    fn reset(
        &mut self,
        position: Numbers<'_>,
        velocity: Option<Numbers<'_>>,
        acceleration: Option<Numbers<'_>>,
    ) -> PyResult<()> {
        let n = self.generator.joints();
        let position = vector(&position, n, "position")?;
        let velocity = vector_or_zeros(velocity.as_ref(), n, "velocity")?;
        let acceleration = vector_or_zeros(acceleration.as_ref(), n, "acceleration")?;
        if let Some(value) = [position, &velocity, &acceleration].concat().iter().find(|v| v.abs() > LARGEST) {
            return Err(bad(format!("{value} is not the state of a joint; expected at most {LARGEST}")));
        }
        self.generator.reset(position, &velocity, &acceleration);
        Ok(())
    }

    #[pyo3(signature = (target, speed_override=1.0))]
    fn step<'py>(&mut self, py: Python<'py>, target: Numbers<'py>, speed_override: f64) -> PyResult<Vector<'py>> {
        if !(0.0..=1.0).contains(&speed_override) {
            return Err(bad(format!("speed_override is {speed_override}, expected 0 to 1")));
        }
        if self.generator.position[0].is_nan() {
            return Err(bad("where the joints are is unknown: call reset first".into()));
        }
        self.generator.step(vector(&target, self.generator.joints(), "target")?, speed_override);
        Ok(self.position(py))
    }

    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.generator.position)
    }

    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.generator.velocity)
    }

    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.generator.acceleration)
    }

    #[getter]
    fn at_rest(&self) -> bool {
        self.generator.at_rest()
    }
}
