//! `TrajectoryGenerator` for Python.

use super::arrays::{bad, finite};
use crate::trajectory::{MotionLimit, TrajectoryGenerator};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

type Vector<'py> = Bound<'py, PyArray1<f64>>;

/// rad, rad/s, rad/s^2: a greater number is not the state of a joint.
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
    fn new(
        max_velocity: PyReadonlyArray1<'_, f64>,
        max_acceleration: PyReadonlyArray1<'_, f64>,
        max_jerk: PyReadonlyArray1<'_, f64>,
        dt: f64,
    ) -> PyResult<Self> {
        let (velocity, acceleration, jerk) =
            (max_velocity.as_slice()?, max_acceleration.as_slice()?, max_jerk.as_slice()?);
        if acceleration.len() != velocity.len() || jerk.len() != velocity.len() || velocity.is_empty() {
            return Err(bad(format!(
                "max_velocity has {}, max_acceleration {}, max_jerk {} entries; expected one of each for every joint",
                velocity.len(),
                acceleration.len(),
                jerk.len()
            )));
        }
        if [velocity, acceleration, jerk, &[dt]].concat().iter().any(|v| !(*v > 0.0) || !v.is_finite()) {
            return Err(bad("max_velocity, max_acceleration, max_jerk and dt must be positive and finite".into()));
        }
        let limits = (0..velocity.len())
            .map(|i| MotionLimit { velocity: velocity[i], acceleration: acceleration[i], jerk: jerk[i] })
            .collect();
        Ok(Self { generator: TrajectoryGenerator::new(limits, dt).map_err(bad)? })
    }

    #[pyo3(signature = (position, velocity=None, acceleration=None))]
    fn reset(
        &mut self,
        position: PyReadonlyArray1<'_, f64>,
        velocity: Option<PyReadonlyArray1<'_, f64>>,
        acceleration: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<()> {
        let zeros = vec![0.0; self.generator.joints()];
        let position = self.joints(&position, "position")?.to_vec();
        let velocity = velocity.as_ref().map_or(Ok(&zeros[..]), |a| self.joints(a, "velocity"))?.to_vec();
        let acceleration = acceleration.as_ref().map_or(Ok(&zeros[..]), |a| self.joints(a, "acceleration"))?.to_vec();
        if let Some(value) = [&position, &velocity, &acceleration].into_iter().flatten().find(|v| v.abs() > LARGEST) {
            return Err(bad(format!("{value} is not the state of a joint; expected at most {LARGEST}")));
        }
        self.generator.reset(&position, &velocity, &acceleration);
        Ok(())
    }

    #[pyo3(signature = (target, speed_override=1.0))]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        target: PyReadonlyArray1<'py, f64>,
        speed_override: f64,
    ) -> PyResult<Vector<'py>> {
        if !(0.0..=1.0).contains(&speed_override) {
            return Err(bad(format!("speed_override is {speed_override}, expected 0 to 1")));
        }
        let target = self.started(&target)?.to_vec();
        self.generator.step(&target, speed_override);
        Ok(self.position(py))
    }

    fn duration(&self, target: PyReadonlyArray1<'_, f64>) -> PyResult<f64> {
        Ok(self.generator.duration(self.started(&target)?))
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
    fn target<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.generator.target)
    }

    #[getter]
    fn at_rest(&self) -> bool {
        self.generator.at_rest()
    }
}

impl PyTrajectoryGenerator {
    fn started<'a>(&self, target: &'a PyReadonlyArray1<'_, f64>) -> PyResult<&'a [f64]> {
        if self.generator.position[0].is_nan() {
            return Err(bad("where the joints are is unknown: call reset first".into()));
        }
        self.joints(target, "target")
    }

    fn joints<'a>(&self, a: &'a PyReadonlyArray1<'_, f64>, what: &str) -> PyResult<&'a [f64]> {
        let (a, n) = (a.as_slice()?, self.generator.joints());
        if a.len() != n {
            return Err(bad(format!("{what} has {} values for {n} joints", a.len())));
        }
        finite(a, what)?;
        Ok(a)
    }
}
