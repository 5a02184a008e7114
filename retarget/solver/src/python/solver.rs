//! `Solver` for Python; and `solve_hierarchy`, one linear solve, for tests of the hierarchy by itself.

use super::arrays::{bad, entries, table, time_step, vector, vector_or_zeros, Flags, Matrix, Numbers, Table, Vector};
use super::body::PyBody;
use super::braking::limits;
use super::observers::{obstacle_poses, PyObservers};
use super::task::PyTask;
use crate::frame::{FrameSolver, Settings};
use crate::hierarchy::{Outcome, Problem, Stages, BUDGET, LEAST_DAMPING};
use crate::observers::Activation;
use crate::task::{Task, TaskKind};
use numpy::PyUntypedArrayMethods;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// A body, its levels and limits, and the state of the convergence loop; see `retarget/_solver.pyi`.
#[pyclass(name = "Solver", module = "retarget._solver")]
pub struct PySolver {
    solver: FrameSolver,
}

/// Refuse a task on an unknown link, and a posture of another size.
fn check_task(task: &PyTask, links: usize, nv: usize) -> PyResult<()> {
    if task.link.is_some_and(|link| link >= links) {
        return Err(bad("a task sits on a link the body does not have".into()));
    }
    if matches!(task.task.kind, TaskKind::Posture) && task.task.weight.len() != nv {
        return Err(bad(format!("a posture task needs {nv} weights")));
    }
    Ok(())
}

/// Fill in the observers of tasks that name none. Refuse tasks of unknown observers, and tasks beside a posture in the last level, in which
/// rows are no limits.
fn check_observed(levels: &mut [Vec<Task>], count: usize) -> PyResult<()> {
    let last = levels.len().saturating_sub(1);
    for (k, level) in levels.iter_mut().enumerate() {
        let soft = k == last && level.iter().any(|t| matches!(t.kind, TaskKind::Posture));
        for task in level {
            let TaskKind::Observers(task) = &mut task.kind else { continue };
            if soft {
                return Err(bad("observers cannot share the last level with a posture".into()));
            }
            if task.of.len() > count && task.named {
                return Err(bad(format!("a task is of an observer that is not among the {count}")));
            }
            if !task.named {
                task.of = vec![true; count];
            }
            task.of.resize(count, false);
        }
    }
    Ok(())
}

#[pymethods]
impl PySolver {
    #[new]
    #[pyo3(signature = (body, levels, *, lower, upper, max_velocity, max_acceleration, locked, n_ik=2, max_step=0.3,
                        damping=0.5, early_stop=true, observers=None, activation="closest"))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        body: &PyBody,
        levels: Vec<Vec<PyRef<'_, PyTask>>>,
        lower: Numbers<'_>,
        upper: Numbers<'_>,
        max_velocity: Numbers<'_>,
        max_acceleration: Numbers<'_>,
        locked: Flags<'_>,
        n_ik: usize,
        max_step: f64,
        damping: f64,
        early_stop: bool,
        observers: Option<PyRef<'_, PyObservers>>,
        activation: &str,
    ) -> PyResult<Self> {
        let (body, nv) = (body.body.clone(), body.body.nv);
        entries(&lower, nv, "lower")?;
        let limits = limits(&lower, &upper, &max_velocity, &max_acceleration)?;
        let locked = entries(&locked, nv, "locked")?;
        if n_ik == 0 || n_ik > 1000 {
            return Err(bad(format!("n_ik is {n_ik}, expected 1 to 1000")));
        }
        if !(max_step > 0.0 && damping >= 0.0 && damping.is_finite()) {
            return Err(bad(format!("max_step {max_step} must be positive, damping {damping} not negative")));
        }
        levels.iter().flatten().try_for_each(|task| check_task(task, body.links.len(), nv))?;
        let mut levels: Vec<Vec<Task>> =
            levels.into_iter().map(|l| l.iter().map(|t| t.task.clone()).collect()).collect();
        check_observed(&mut levels, observers.as_ref().map_or(0, |o| o.set.observers.len()))?;
        let activation = match activation {
            "closest" => Activation::Closest,
            "all" => Activation::All,
            _ => return Err(bad(format!("activation is {activation:?}, expected closest or all"))),
        };
        let watched = observers.map(|observers| (observers.set.clone(), activation));
        let settings = Settings { n_ik, max_step, damping, early_stop };
        Ok(Self { solver: FrameSolver::new(body, levels, limits, locked, watched, settings) })
    }

    #[getter]
    fn target_size(&self) -> usize {
        self.solver.target_size
    }

    fn target_slice(&self, level: usize, task: usize) -> PyResult<(usize, usize)> {
        let place = self.solver.slices().filter(|(of, _)| *of == level).nth(task);
        place.map(|(_, r)| (r.start, r.end)).ok_or_else(|| bad(format!("level {level} has no task {task}")))
    }

    #[pyo3(signature = (q, velocity=None))]
    fn reset(&mut self, q: Numbers<'_>, velocity: Option<Numbers<'_>>) -> PyResult<()> {
        let q = vector(&q, self.solver.body.nq, "q")?;
        let velocity = vector_or_zeros(velocity.as_ref(), self.solver.body.nv, "velocity")?;
        self.solver.reset(q, &velocity);
        Ok(())
    }

    fn correct(&mut self, q: Numbers<'_>, velocity: Numbers<'_>) -> PyResult<()> {
        let (q, velocity) =
            (vector(&q, self.solver.body.nq, "q")?, vector(&velocity, self.solver.body.nv, "velocity")?);
        self.solver.correct(q, velocity);
        Ok(())
    }

    fn foresee(&mut self, rest: Table<'_>, seconds: f64) -> PyResult<()> {
        let count = rest.shape()[0];
        if count == 0 {
            return Err(bad("at least one posture is foreseen".into()));
        }
        let rest = table(&rest, count, self.solver.body.nq, "rest")?;
        if !(seconds >= 0.0 && seconds.is_finite()) {
            return Err(bad(format!("seconds is {seconds}, expected a number, not negative")));
        }
        self.solver.stop = Some((rest.to_vec(), seconds));
        Ok(())
    }

    #[pyo3(signature = (targets, dt, speed_override=1.0))]
    fn frame<'py>(
        &mut self,
        py: Python<'py>,
        targets: Numbers<'py>,
        dt: f64,
        speed_override: f64,
    ) -> PyResult<Vector<'py>> {
        if !(speed_override > 0.0 && speed_override <= 1.0) {
            return Err(bad(format!("speed_override is {speed_override}, expected more than 0 and at most 1")));
        }
        let (targets, dt) = (entries(&targets, self.solver.target_size, "targets")?, time_step(dt)?);
        let solver = &mut self.solver;
        py.detach(|| solver.frame(targets, speed_override, dt));
        Ok(PyArray1::from_slice(py, &self.solver.q))
    }

    #[pyo3(signature = (dt, most, *, pendulum=0.0))]
    fn brake<'py>(&mut self, py: Python<'py>, dt: f64, most: usize, pendulum: f64) -> PyResult<Matrix<'py>> {
        let (solver, dt) = (&mut self.solver, time_step(dt)?);
        if !(pendulum >= 0.0 && pendulum.is_finite()) {
            return Err(bad(format!("pendulum is {pendulum}, expected s, not negative")));
        }
        let postures = py.detach(|| solver.brake(dt, most, pendulum));
        let rows = postures.len() / solver.body.nq;
        PyArray1::from_vec(py, postures).reshape([rows, solver.body.nq])
    }

    #[pyo3(signature = (position, quat, linear=None, angular=None, present=None))]
    fn set_obstacles(
        &mut self,
        position: Table<'_>,
        quat: Table<'_>,
        linear: Option<Table<'_>>,
        angular: Option<Table<'_>>,
        present: Option<Flags<'_>>,
    ) -> PyResult<()> {
        let Some(monitor) = &mut self.solver.monitor else { return Err(bad("this solver has no observers".into())) };
        let k = monitor.obstacles.len();
        let poses = obstacle_poses(k, &position, &quat, linear.as_ref(), angular.as_ref())?;
        let everywhere = vec![true; k];
        let present = present.as_ref().map_or(Ok(&everywhere[..]), |present| entries(present, k, "present"))?;
        for (i, (pose, present)) in poses.into_iter().zip(present).enumerate() {
            monitor.set_obstacle(i, pose, *present);
        }
        Ok(())
    }

    #[getter]
    fn observer_modes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        let modes = self.solver.monitor.as_ref().map_or(vec![], |all| all.modes.iter().map(|m| *m as u8).collect());
        PyArray1::from_vec(py, modes)
    }

    #[getter]
    fn clearance(&mut self) -> (f64, f64) {
        self.solver.monitor.as_mut().map_or((f64::INFINITY, f64::INFINITY), |monitor| monitor.clearance())
    }

    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.solver.q)
    }

    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.solver.velocity)
    }

    #[getter]
    fn task_errors<'py>(&self, py: Python<'py>) -> Vector<'py> {
        PyArray1::from_slice(py, &self.solver.task_errors)
    }

    #[getter]
    fn capped(&self) -> u64 {
        self.solver.stats.capped
    }
}

/// See `retarget/_solver.pyi`.
#[pyfunction]
#[pyo3(signature = (rows, lower, upper, level_sizes, *, lo, hi, still, damping, soft_last=false, least_damping=LEAST_DAMPING, rounds=1, budget=BUDGET))]
#[allow(clippy::too_many_arguments)]
pub fn solve_hierarchy<'py>(
    py: Python<'py>,
    rows: Table<'py>,
    lower: Numbers<'py>,
    upper: Numbers<'py>,
    level_sizes: Vec<usize>,
    lo: Numbers<'py>,
    hi: Numbers<'py>,
    still: Numbers<'py>,
    damping: f64,
    soft_last: bool,
    least_damping: f64,
    rounds: usize,
    budget: u32,
) -> PyResult<(Vector<'py>, u32, bool)> {
    let (n, m) = (lo.as_slice()?.len(), level_sizes.iter().sum());
    let mut problem = Problem::new(n, &level_sizes);
    for (r, row) in table(&rows, m, n, "rows")?.chunks_exact(n).enumerate() {
        problem.row_mut(r)[..n].copy_from_slice(row);
    }
    problem.lower.copy_from_slice(entries(&lower, m, "lower")?);
    problem.upper.copy_from_slice(entries(&upper, m, "upper")?);
    problem.present.fill(true);
    problem.lo.copy_from_slice(lo.as_slice()?);
    problem.hi.copy_from_slice(entries(&hi, n, "hi")?);
    problem.still[..n].copy_from_slice(entries(&still, n, "still")?);
    (problem.damping, problem.least_damping, problem.soft_last) = (damping, least_damping, soft_last);
    problem.rounds = rounds;
    let Outcome { steps, capped } = Stages::default().solve(&mut problem, budget);
    Ok((PyArray1::from_slice(py, &problem.z[..n]), steps, capped))
}
