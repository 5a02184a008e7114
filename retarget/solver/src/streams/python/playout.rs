//! A playout buffer for Python.

use crate::python::arrays::{bad, indices, numbers};
use crate::streams::playout::{Shown, Stored, Track};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

type Numbers<'py> = Bound<'py, PyArray1<f64>>;
type Table<'py> = Bound<'py, PyArray2<f64>>;
type Played<'py> =
    (Table<'py>, Table<'py>, Bound<'py, PyArray1<bool>>, Numbers<'py>, Bound<'py, PyArray1<i8>>, Numbers<'py>);

/// See `retarget/_solver.pyi`.
#[pyclass(name = "PoseRing", module = "retarget._solver")]
pub struct PyPoseRing {
    tracks: Vec<Track>,
    shown: Vec<Shown>,
}

#[pymethods]
impl PyPoseRing {
    #[new]
    #[pyo3(signature = (count, *, depth, extrapolation))]
    fn new(count: usize, depth: usize, extrapolation: f64) -> PyResult<Self> {
        if count == 0 || depth < 2 {
            return Err(bad(format!("a ring has 1 sensor and 2 poses at least; found {count} and {depth}")));
        }
        Ok(Self { tracks: vec![Track::new(depth, extrapolation); count], shown: Vec::with_capacity(count) })
    }

    fn push(
        &mut self,
        rows: PyReadonlyArray1<'_, i64>,
        time: f64,
        position: PyReadonlyArray2<'_, f64>,
        orientation: PyReadonlyArray2<'_, f64>,
        valid: PyReadonlyArray1<'_, bool>,
    ) -> PyResult<(Option<f64>, u32, u32)> {
        let rows = indices(&rows, self.tracks.len())?;
        let (position, orientation) =
            (numbers::<3>(&position, rows.len(), "position")?, numbers::<4>(&orientation, rows.len(), "orientation")?);
        let valid = valid.as_slice()?;
        if valid.len() != rows.len() {
            return Err(bad(format!("valid has {} entries, expected {}", valid.len(), rows.len())));
        }
        let (mut newest, mut repeated, mut too_old) = (None, 0, 0);
        for (i, row) in rows.iter().enumerate() {
            let track = &mut self.tracks[*row as usize];
            let before = track.newest();
            match track.push(time, position[i], orientation[i], valid[i]) {
                Stored::Lost => continue,
                Stored::Repeated => repeated += 1,
                Stored::TooOld => too_old += 1,
                Stored::Yes => {}
            }
            newest = Some(newest.map_or(before, |other: f64| other.max(before)));
        }
        Ok((newest, repeated, too_old))
    }

    fn latest<'py>(&mut self, py: Python<'py>, now: f64) -> PyResult<Played<'py>> {
        self.shown.clear();
        self.shown.extend(self.tracks.iter_mut().map(|track| track.latest(now)));
        self.played(py)
    }

    fn read<'py>(&mut self, py: Python<'py>, at: f64, now: f64) -> PyResult<Played<'py>> {
        self.shown.clear();
        self.shown.extend(self.tracks.iter_mut().map(|track| track.read(at, now)));
        self.played(py)
    }

    fn clear(&mut self) {
        self.tracks.iter_mut().for_each(Track::clear);
    }
}

impl PyPoseRing {
    fn played<'py>(&self, py: Python<'py>) -> PyResult<Played<'py>> {
        let count = self.shown.len();
        let (position, orientation) = (PyArray2::zeros(py, [count, 3], false), PyArray2::zeros(py, [count, 4], false));
        for (row, shown) in position.readwrite().as_slice_mut()?.chunks_exact_mut(3).zip(&self.shown) {
            row.copy_from_slice(&shown.position);
        }
        for (row, shown) in orientation.readwrite().as_slice_mut()?.chunks_exact_mut(4).zip(&self.shown) {
            row.copy_from_slice(&shown.orientation);
        }
        Ok((
            position,
            orientation,
            PyArray1::from_iter(py, self.shown.iter().map(|shown| shown.valid)),
            PyArray1::from_iter(py, self.shown.iter().map(|shown| shown.age)),
            PyArray1::from_iter(py, self.shown.iter().map(|shown| shown.how as i8)),
            PyArray1::from_iter(py, self.shown.iter().map(|shown| shown.time)),
        ))
    }
}
