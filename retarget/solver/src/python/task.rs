//! `Task` for Python.

use super::arrays::{bad, Numbers};
use crate::math::quat_unit;
use crate::observers::ObserverTask;
use crate::task::{Task, TaskKind};

use pyo3::prelude::*;

/// Most observers of a task. A larger number is an error of the caller, and would only fill the memory.
const MOST_OBSERVERS: usize = 10_000;

/// A task of a body; see `retarget/_solver.pyi`.
#[pyclass(name = "Task", module = "retarget._solver", frozen)]
pub struct PyTask {
    pub task: Task,
    pub link: Option<usize>,
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

fn few(max_edges: usize) -> PyResult<usize> {
    if max_edges == 0 || max_edges > 64 {
        return Err(bad(format!("max_edges is {max_edges}, expected 1 to 64")));
    }
    Ok(max_edges)
}

/// A task of the observers with the numbers `of`, or of all.
fn observers(reactive: bool, of: Option<Vec<usize>>, against: &str, speed: f64) -> PyResult<PyTask> {
    let (with_self, with_scene) = match against {
        "all" => (true, true),
        "self" => (true, false),
        "scene" => (false, true),
        _ => return Err(bad(format!("against is {against:?}, expected all, self or scene"))),
    };
    if !(speed > 0.0 && speed.is_finite()) {
        return Err(bad(format!("speed is {speed}, expected positive m/s")));
    }
    let named = of.is_some();
    let of = of.unwrap_or_default();
    let mut members = vec![false; of.iter().max().map_or(0, |most| most.saturating_add(1).min(MOST_OBSERVERS))];
    for k in of {
        *members.get_mut(k).ok_or_else(|| bad(format!("observer {k} of at most {MOST_OBSERVERS}")))? = true;
    }
    let task = ObserverTask { reactive, named, of: members, with_self, with_scene, speed, ..Default::default() };
    make(TaskKind::Observers(task), vec![], 1.0, f64::INFINITY, None)
}

#[pymethods]
impl PyTask {
    #[staticmethod]
    #[pyo3(signature = (body, point=[0.0; 3], *, base=None, weight=[1.0; 3], gain=1.0, max_error=0.05))]
    fn position(
        body: usize,
        point: [f64; 3],
        base: Option<(usize, [f64; 3])>,
        weight: [f64; 3],
        gain: f64,
        max_error: f64,
    ) -> PyResult<Self> {
        let last = base.map_or(body, |(link, _)| link.max(body));
        make(TaskKind::Position { link: body, point, from: base }, weight.to_vec(), gain, max_error, Some(last))
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
        make(TaskKind::Axis { link: body, axis, eye: None }, vec![weight; 2], gain, max_error, Some(body))
    }

    #[staticmethod]
    #[pyo3(signature = (*, weight=[1.0; 3], over=None, gain=1.0, max_error=0.05))]
    fn centre_of_mass(weight: [f64; 3], over: Option<usize>, gain: f64, max_error: f64) -> PyResult<Self> {
        make(TaskKind::CentreOfMass { over }, weight.to_vec(), gain, max_error, over)
    }

    #[staticmethod]
    #[pyo3(signature = (max_edges, *, without=vec![], max_error=0.05))]
    fn support(max_edges: usize, mut without: Vec<usize>, max_error: f64) -> PyResult<Self> {
        without.sort_unstable();
        let kind = TaskKind::Support { point: None, max_edges: few(max_edges)?, without };
        make(kind, vec![], 1.0, max_error, None)
    }

    #[staticmethod]
    #[pyo3(signature = (body, point, max_edges, *, max_error=0.05))]
    fn lever(body: usize, point: [f64; 3], max_edges: usize, max_error: f64) -> PyResult<Self> {
        let kind = TaskKind::Support { point: Some((body, point)), max_edges: few(max_edges)?, without: vec![] };
        make(kind, vec![], 1.0, max_error, Some(body))
    }

    #[staticmethod]
    #[pyo3(signature = (body, point, axis, *, weight=1.0, gain=1.0, max_error=0.2))]
    fn look_at(body: usize, point: [f64; 3], axis: [f64; 3], weight: f64, gain: f64, max_error: f64) -> PyResult<Self> {
        let axis = crate::math::unit_or(axis, [1.0, 0.0, 0.0]);
        make(TaskKind::Axis { link: body, axis, eye: Some(point) }, vec![weight; 2], gain, max_error, Some(body))
    }

    #[staticmethod]
    #[pyo3(signature = (*, of=None, against="all", speed=0.1))]
    fn reactive(of: Option<Vec<usize>>, against: &str, speed: f64) -> PyResult<Self> {
        observers(true, of, against, speed)
    }

    #[staticmethod]
    #[pyo3(signature = (*, of=None, against="all", speed=0.5))]
    fn preventive(of: Option<Vec<usize>>, against: &str, speed: f64) -> PyResult<Self> {
        observers(false, of, against, speed)
    }

    #[staticmethod]
    #[pyo3(signature = (weight, *, gain=1.0, max_error=0.3))]
    fn posture(weight: Numbers<'_>, gain: f64, max_error: f64) -> PyResult<Self> {
        make(TaskKind::Posture, weight.as_slice()?.to_vec(), gain, max_error, None)
    }
}
