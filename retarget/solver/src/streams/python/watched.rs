//! Watched sensors for Python.

use crate::python::arrays::{bad, indices, numbers};
use crate::streams::last_poses::{Last, Pose};
use crate::streams::pose_check::{Room, Verdict};
use crate::streams::stillness::Times;
use crate::streams::watched::Watched;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

type Verdicts<'py> = (Bound<'py, PyArray1<u8>>, bool);

/// See `retarget/_solver.pyi`.
#[pyclass(name = "WatchedSensors", module = "retarget._solver")]
pub struct PyWatchedSensors {
    watched: Watched,
    verdicts: Vec<Verdict>,
}

#[pymethods]
impl PyWatchedSensors {
    #[new]
    #[pyo3(signature = (count, *, reach, height, norm_tolerance, stale_after, frozen_after, noticeable, not_in_use_after))]
    #[allow(clippy::too_many_arguments)]
    fn new(
        count: usize,
        reach: f64,
        height: (f64, f64),
        norm_tolerance: f64,
        stale_after: f64,
        frozen_after: f64,
        noticeable: (f64, f64),
        not_in_use_after: f64,
    ) -> Self {
        let room = Room { reach, low: height.0, high: height.1, norm: norm_tolerance };
        let times = Times { stale_after, frozen_after, noticeable };
        Self { watched: Watched::new(count, room, times, not_in_use_after), verdicts: Vec::with_capacity(count) }
    }

    fn take<'py>(
        &mut self,
        rows: PyReadonlyArray1<'py, i64>,
        time: f64,
        position: PyReadonlyArray2<'py, f64>,
        orientation: PyReadonlyArray2<'py, f64>,
        tracked: PyReadonlyArray1<'py, bool>,
        look_again: bool,
    ) -> PyResult<Option<Verdicts<'py>>> {
        let py = rows.py();
        let rows = indices(&rows, self.watched.last.len())?;
        let (position, orientation) =
            (numbers::<3>(&position, rows.len(), "position")?, numbers::<4>(&orientation, rows.len(), "orientation")?);
        let tracked = tracked.as_slice()?;
        if tracked.len() != rows.len() {
            return Err(bad(format!("tracked has {} entries, expected {}", tracked.len(), rows.len())));
        }
        let poses = || rows.iter().zip(position).zip(orientation).map(|((row, p), q)| (*row as usize, *p, *q));
        self.verdicts.clear();
        for ((row, p, q), tracked) in poses().zip(tracked) {
            let verdict = self.watched.verdict(row, time, p, q, *tracked);
            self.verdicts.push(verdict);
        }
        let verdicts = &self.verdicts;
        let valid = poses().zip(verdicts).filter(|(_, verdict)| **verdict == Verdict::Valid).map(|(pose, _)| pose);
        let taken = !look_again && self.watched.take_calm(time, valid);
        if taken && verdicts.iter().all(|verdict| *verdict == Verdict::Valid) {
            return Ok(None);
        }
        Ok(Some((PyArray1::from_iter(py, verdicts.iter().map(|verdict| *verdict as u8)), taken)))
    }

    fn put(&mut self, rows: PyReadonlyArray1<'_, i64>, time: f64, pose: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
        let rows = indices(&rows, self.watched.last.len())?;
        let pose = numbers::<7>(&pose, rows.len(), "pose")?;
        self.watched.put(time, rows.iter().map(|row| *row as usize).zip(pose.iter().copied()));
        Ok(())
    }

    fn forget_turn(&mut self, rows: PyReadonlyArray1<'_, i64>) -> PyResult<()> {
        for row in indices(&rows, self.watched.last.len())? {
            self.watched.last[*row as usize].forget_turn();
        }
        Ok(())
    }

    fn judge<'py>(&mut self, py: Python<'py>, now: f64) -> Bound<'py, PyArray1<u8>> {
        let count = self.watched.last.len();
        let states = PyArray1::zeros(py, [count], false);
        {
            let mut states = states.readwrite();
            let mut found = self.watched.judge(now);
            states.as_array_mut().map_inplace(|state| *state = found.next().map_or(0, |one| one as u8));
        }
        states
    }

    #[getter]
    fn latest(&self) -> f64 {
        self.watched.latest
    }

    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.table(py, |last| last.pose)
    }

    #[getter]
    fn step<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.table(py, |last| last.step)
    }

    #[getter]
    fn since<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.table(py, |last| last.since)
    }

    #[getter]
    fn at<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |last| last.at)
    }

    #[getter]
    fn before<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |last| last.before)
    }

    #[getter]
    fn still_for<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, Last::still_for)
    }
}

impl PyWatchedSensors {
    fn column<'py>(&self, py: Python<'py>, of: impl Fn(&Last) -> f64) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.watched.last.iter().map(of))
    }

    fn table<'py>(&self, py: Python<'py>, of: impl Fn(&Last) -> Pose) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let values = self.watched.last.iter().flat_map(of);
        PyArray1::from_iter(py, values).reshape([self.watched.last.len(), 7])
    }
}
