//! `Task` and `Solver` for Python.

use crate::frame::{FrameSolver, Settings};
use crate::math::quat_unit;
use crate::py_arrays::{bad, finite};
use crate::py_body::PyBody;
use crate::py_bounds::limits;
use crate::task::{Task, TaskKind};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::collections::HashMap;

/// What is asked of the body; see `retarget/_solver.pyi`.
#[pyclass(name = "Task", module = "retarget._solver", frozen)]
pub struct PyTask {
    task: Task,
    link: Option<usize>,
}

fn make(kind: TaskKind, weight: Vec<f64>, gain: f64, max_error: f64, link: Option<usize>) -> PyResult<PyTask> {
    if weight.iter().any(|w| !w.is_finite() || *w < 0.0) {
        return Err(bad("a task's weights must be finite and not negative".into()));
    }
    if !(gain > 0.0 && gain <= 1.0 && max_error > 0.0) {
        return Err(bad(format!("gain {gain} must be in (0, 1], max_error {max_error} positive")));
    }
    Ok(PyTask { task: Task { kind, weight, gain, max_error }, link })
}

#[pymethods]
impl PyTask {
    #[staticmethod]
    #[pyo3(signature = (body, point=[0.0; 3], *, weight=[1.0; 3], gain=1.0, max_error=0.05))]
    fn position(body: usize, point: [f64; 3], weight: [f64; 3], gain: f64, max_error: f64) -> PyResult<Self> {
        make(TaskKind::Position { link: body, point }, weight.to_vec(), gain, max_error, Some(body))
    }

    #[staticmethod]
    #[pyo3(signature = (body, quat=[1.0, 0.0, 0.0, 0.0], *, weight=[1.0; 3], gain=1.0, max_error=0.2))]
    fn orientation(body: usize, quat: [f64; 4], weight: [f64; 3], gain: f64, max_error: f64) -> PyResult<Self> {
        make(TaskKind::Orientation { link: body, quat: quat_unit(quat) }, weight.to_vec(), gain, max_error, Some(body))
    }

    #[staticmethod]
    #[pyo3(signature = (body, axis, *, weight=1.0, gain=1.0, max_error=0.2))]
    fn axis(body: usize, axis: [f64; 3], weight: f64, gain: f64, max_error: f64) -> PyResult<Self> {
        let axis = crate::math::unit_or(axis, [1.0, 0.0, 0.0]);
        make(TaskKind::Axis { link: body, axis }, vec![weight; 2], gain, max_error, Some(body))
    }

    #[staticmethod]
    #[pyo3(signature = (*, weight=[1.0; 3], over=None, gain=1.0, max_error=0.05))]
    fn centre_of_mass(weight: [f64; 3], over: Option<usize>, gain: f64, max_error: f64) -> PyResult<Self> {
        make(TaskKind::CentreOfMass { over }, weight.to_vec(), gain, max_error, over)
    }

    #[staticmethod]
    #[pyo3(signature = (max_edges, *, max_error=0.05))]
    fn support(max_edges: usize, max_error: f64) -> PyResult<Self> {
        if max_edges == 0 || max_edges > 32 {
            return Err(bad(format!("max_edges is {max_edges}, expected 1 to 32")));
        }
        make(TaskKind::Support { max_edges }, vec![], 1.0, max_error, None)
    }

    #[staticmethod]
    #[pyo3(signature = (body, point, axis, *, weight=1.0, gain=1.0, max_error=0.2))]
    fn look_at(body: usize, point: [f64; 3], axis: [f64; 3], weight: f64, gain: f64, max_error: f64) -> PyResult<Self> {
        let axis = crate::math::unit_or(axis, [1.0, 0.0, 0.0]);
        make(TaskKind::LookAt { link: body, point, axis }, vec![weight; 2], gain, max_error, Some(body))
    }

    #[staticmethod]
    #[pyo3(signature = (weight, *, gain=1.0, max_error=0.3))]
    fn posture(weight: PyReadonlyArray1<'_, f64>, gain: f64, max_error: f64) -> PyResult<Self> {
        make(TaskKind::Posture, weight.as_slice()?.to_vec(), gain, max_error, None)
    }
}

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
                        damping=1.0, early_stop=true))]
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
        let levels = levels.into_iter().map(|l| l.iter().map(|t| t.task.clone()).collect()).collect();
        let settings = Settings { n_ik, max_step, damping, early_stop };
        let solver = FrameSolver::new(body.body.clone(), levels, limits, locked, settings);
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
        let velocity = match &velocity {
            Some(v) => v.as_slice()?,
            None => &still,
        };
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
        let (frames, size, nq) = (targets.shape()[0], self.solver.target_size, self.solver.body.nq);
        let all = targets.as_slice()?;
        let solver = &mut self.solver;
        let out = py.detach(|| {
            let mut out = vec![0.0; frames * nq];
            for (t, row) in out.chunks_exact_mut(nq).enumerate() {
                solver.frame(&all[t * size..(t + 1) * size], dt);
                row.copy_from_slice(&solver.q);
            }
            out
        });
        PyArray1::from_vec(py, out).reshape([frames, nq])
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
            ("allocations", s.allocations),
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
