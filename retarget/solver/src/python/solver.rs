//! `Solver` for Python.

use super::arrays::{bad, finite, triple};
use super::body::PyBody;
use super::braking::limits;
use super::observers::{activation_named, check_observed, obstacle_rows, PyObservers};
use super::task::PyTask;
use crate::frame::{FrameSolver, Settings};
use crate::math::quat_unit;
use crate::observers::ObstaclePose;
use crate::task::{Task, TaskKind};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::collections::HashMap;

/// A body, its levels and limits, and the state of the convergence loop; see `retarget/_solver.pyi`.
#[pyclass(name = "Solver", module = "retarget._solver")]
pub struct PySolver {
    solver: FrameSolver,
    /// (level, task) -> (start, stop)
    places: Vec<(usize, usize, usize)>,
}

#[pymethods]
impl PySolver {
    #[new]
    #[pyo3(signature = (body, levels, *, lower, upper, max_velocity, max_acceleration, locked, n_ik=5, max_step=0.3,
                        damping=1.0, early_stop=true, observers=None, activation="closest"))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        body: &PyBody,
        levels: Vec<Vec<PyRef<'_, PyTask>>>,
        lower: PyReadonlyArray1<'_, f64>,
        upper: PyReadonlyArray1<'_, f64>,
        max_velocity: PyReadonlyArray1<'_, f64>,
        max_acceleration: PyReadonlyArray1<'_, f64>,
        locked: PyReadonlyArray1<'_, bool>,
        n_ik: usize,
        max_step: f64,
        damping: f64,
        early_stop: bool,
        observers: Option<PyRef<'_, PyObservers>>,
        activation: &str,
    ) -> PyResult<Self> {
        let nv = body.body.nv;
        let limits =
            limits(lower.as_slice()?, upper.as_slice()?, max_velocity.as_slice()?, max_acceleration.as_slice()?)?;
        let locked = locked.as_slice()?;
        if limits.len() != nv || locked.len() != nv {
            return Err(bad(format!("limits have {} entries, locked {}, the body {nv}", limits.len(), locked.len())));
        }
        if n_ik == 0 || n_ik > 1000 {
            return Err(bad(format!("n_ik is {n_ik}, expected 1 to 1000")));
        }
        if !(max_step > 0.0 && damping >= 0.0 && damping.is_finite()) {
            return Err(bad(format!("max_step {max_step} must be positive, damping {damping} not negative")));
        }
        for (level, tasks) in levels.iter().enumerate() {
            for (k, task) in tasks.iter().enumerate() {
                if task.link.is_some_and(|link| link >= body.body.links.len()) {
                    return Err(bad(format!("task {k} of level {level} sits on a link the body does not have")));
                }
                if matches!(task.task.kind, TaskKind::Posture) && task.task.weight.len() != nv {
                    return Err(bad(format!("posture task {k} of level {level} needs {nv} weights")));
                }
            }
        }
        let mut levels: Vec<Vec<Task>> =
            levels.into_iter().map(|l| l.iter().map(|t| t.task.clone()).collect()).collect();
        check_observed(&mut levels, observers.as_deref())?;
        let watched = match observers {
            Some(observers) => Some((observers.set.clone(), activation_named(activation)?)),
            None => None,
        };
        let settings = Settings { n_ik, max_step, damping, early_stop };
        let solver = FrameSolver::new(body.body.clone(), levels, limits, locked, watched, settings);
        let places = solver.slices().map(|(level, r)| (level, r.start, r.end)).collect();
        Ok(Self { solver, places })
    }

    #[getter]
    fn target_size(&self) -> usize {
        self.solver.target_size
    }

    /// (start, stop) of a task in the target vector, its leading weight included.
    fn target_slice(&self, level: usize, task: usize) -> PyResult<(usize, usize)> {
        self.places
            .iter()
            .filter(|p| p.0 == level)
            .nth(task)
            .map(|p| (p.1, p.2))
            .ok_or_else(|| bad(format!("level {level} has no task {task}")))
    }

    #[pyo3(signature = (q, velocity=None))]
    fn reset(&mut self, q: PyReadonlyArray1<'_, f64>, velocity: Option<PyReadonlyArray1<'_, f64>>) -> PyResult<()> {
        let q = q.as_slice()?;
        let (nq, nv) = (self.solver.body.nq, self.solver.body.nv);
        let still = vec![0.0; nv];
        let velocity = velocity.as_ref().map_or(Ok(&still[..]), |v| v.as_slice())?;
        if q.len() != nq || velocity.len() != nv {
            return Err(bad(format!(
                "q has {} entries and velocity {}, the body {nq} and {nv}",
                q.len(),
                velocity.len()
            )));
        }
        finite(q, "q")?;
        finite(velocity, "velocity")?;
        self.solver.reset(q, velocity);
        Ok(())
    }

    /// One frame: posture (nq,) after `dt` seconds towards `targets`.
    fn frame<'py>(
        &mut self,
        py: Python<'py>,
        targets: PyReadonlyArray1<'py, f64>,
        dt: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let targets = targets.as_slice()?;
        self.check_targets(targets.len(), dt)?;
        let solver = &mut self.solver;
        py.detach(|| solver.frame(targets, dt));
        Ok(PyArray1::from_slice(py, &self.solver.q))
    }

    /// Many frames: postures (T, nq).
    fn clip<'py>(
        &mut self,
        py: Python<'py>,
        targets: PyReadonlyArray2<'py, f64>,
        dt: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.check_targets(targets.shape()[1], dt)?;
        let (frames, nq) = (targets.shape()[0], self.solver.body.nq);
        let all = targets.as_slice()?;
        let solver = &mut self.solver;
        let out = py.detach(|| {
            let mut out = vec![0.0; frames * nq];
            solver.clip(all, dt, &mut out);
            out
        });
        PyArray1::from_vec(py, out).reshape([frames, nq])
    }

    /// Where obstacles are at the start of the next frame, and how they move.
    #[pyo3(signature = (position, quat, linear=None, angular=None, present=None))]
    fn set_obstacles(
        &mut self,
        position: PyReadonlyArray2<'_, f64>,
        quat: PyReadonlyArray2<'_, f64>,
        linear: Option<PyReadonlyArray2<'_, f64>>,
        angular: Option<PyReadonlyArray2<'_, f64>>,
        present: Option<PyReadonlyArray1<'_, bool>>,
    ) -> PyResult<()> {
        let Some(watch) = &mut self.solver.watch else { return Err(bad("this solver has no observers".into())) };
        let k = watch.obstacles.len();
        let (position, quat) = (obstacle_rows(&position, k, 3, "position")?, obstacle_rows(&quat, k, 4, "quat")?);
        let still = vec![0.0; 3 * k];
        let linear = linear.as_ref().map_or(Ok(&still[..]), |rows| obstacle_rows(rows, k, 3, "linear"))?;
        let angular = angular.as_ref().map_or(Ok(&still[..]), |rows| obstacle_rows(rows, k, 3, "angular"))?;
        let everywhere = vec![true; k];
        let present = present.as_ref().map_or(Ok(&everywhere[..]), |present| present.as_slice())?;
        if present.len() != k {
            return Err(bad(format!("present has {} entries, expected {k}", present.len())));
        }
        for i in 0..k {
            let there = ObstaclePose {
                position: triple(&position[3 * i..]),
                quat: quat_unit([quat[4 * i], quat[4 * i + 1], quat[4 * i + 2], quat[4 * i + 3]]),
                linear: triple(&linear[3 * i..]),
                angular: triple(&angular[3 * i..]),
            };
            watch.set_obstacle(i, there, present[i]);
        }
        Ok(())
    }

    /// What each observer did in the last frame: 0 free, 1 preventive, 2 reactive.
    #[getter]
    fn observer_modes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        let modes = self.solver.watch.as_ref().map_or(vec![], |w| w.tally.last.iter().map(|m| *m as u8).collect());
        PyArray1::from_vec(py, modes)
    }

    /// Per observer since construction (n, 3): changes of mode, frames preventive, frames reactive.
    #[getter]
    fn observer_counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u64>>> {
        let counts = self.solver.watch.as_ref().map_or(vec![], |w| {
            let t = &w.tally;
            (0..t.last.len()).flat_map(|k| [t.switches[k], t.preventive[k], t.reactive[k]]).collect()
        });
        let n = counts.len() / 3;
        PyArray1::from_vec(py, counts).reshape([n, 3])
    }

    /// Smallest distance (m) between observers, and to an obstacle; infinite where nothing is within influence.
    #[getter]
    fn clearance(&mut self) -> (f64, f64) {
        self.solver.watch.as_mut().map_or((f64::INFINITY, f64::INFINITY), |w| w.clearance())
    }

    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solver.q)
    }

    /// Displacement per second of the last frame (nv,).
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solver.velocity)
    }

    /// Error norm of each task at the posture reached, in order of levels; NaN where absent.
    #[getter]
    fn task_errors<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solver.task_errors)
    }

    /// Counters since construction.
    #[getter]
    fn stats(&self) -> HashMap<&'static str, u64> {
        let s = self.solver.stats;
        HashMap::from([
            ("frames", s.frames),
            ("iterations", s.iterations),
            ("factorizations", s.factorizations),
            ("fallbacks", s.fallbacks),
            ("capped", s.capped),
        ])
    }
}

impl PySolver {
    fn check_targets(&self, size: usize, dt: f64) -> PyResult<()> {
        if size != self.solver.target_size {
            return Err(bad(format!("targets have {size} entries, expected {}", self.solver.target_size)));
        }
        if !(dt > 0.0) || !dt.is_finite() {
            return Err(bad(format!("dt is {dt}, expected a positive time in seconds")));
        }
        Ok(())
    }
}
