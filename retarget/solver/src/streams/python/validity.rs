//! Sensor validity for Python.

use crate::python::arrays::{bad, indices, numbers};
use crate::streams::validity::{Limits, Sent, Validity, Verdict};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

/// See `retarget/_solver.pyi`.
#[pyclass(name = "Validity", module = "retarget._solver")]
pub struct PyValidity {
    validity: Validity,
    capture: Vec<Sent>,
    verdicts: Vec<Verdict>,
}

#[pymethods]
impl PyValidity {
    #[new]
    fn new(others: PyReadonlyArray1<'_, i64>, limits: Limits) -> PyResult<Self> {
        let others: Vec<_> = others.as_slice()?.iter().map(|other| usize::try_from(*other).ok()).collect();
        if let Some(other) = others.iter().flatten().find(|other| **other >= others.len()) {
            return Err(bad(format!("sensor {other} does not exist; there are {}", others.len())));
        }
        Ok(Self { validity: Validity::new(others, limits), capture: Vec::new(), verdicts: Vec::new() })
    }

    fn take<'py>(
        &mut self,
        rows: PyReadonlyArray1<'py, i64>,
        time: f64,
        position: PyReadonlyArray2<'py, f64>,
        orientation: PyReadonlyArray2<'py, f64>,
        tracked: PyReadonlyArray1<'py, bool>,
    ) -> PyResult<Option<Bound<'py, PyArray1<u8>>>> {
        let py = rows.py();
        let rows = indices(&rows, self.validity.sensors.len())?;
        let (position, orientation) =
            (numbers::<3>(&position, rows.len(), "position")?, numbers::<4>(&orientation, rows.len(), "orientation")?);
        let tracked = tracked.as_slice()?;
        if tracked.len() != rows.len() {
            return Err(bad(format!("tracked has {} entries, expected {}", tracked.len(), rows.len())));
        }
        let sent = rows.iter().zip(position).zip(orientation).zip(tracked);
        self.capture.clear();
        self.capture.extend(sent.map(|(((row, position), orientation), tracked)| Sent {
            row: *row as usize,
            position: *position,
            orientation: *orientation,
            tracked: *tracked,
        }));
        self.validity.take(time, &self.capture, &mut self.verdicts);
        if self.verdicts.iter().all(|verdict| *verdict == Verdict::Valid) {
            return Ok(None);
        }
        Ok(Some(PyArray1::from_iter(py, self.verdicts.iter().map(|verdict| *verdict as u8))))
    }

    fn judge<'py>(&mut self, py: Python<'py>, now: f64) -> Bound<'py, PyArray1<u8>> {
        let states = PyArray1::zeros(py, [self.validity.sensors.len()], false);
        {
            let mut states = states.readwrite();
            let mut found = self.validity.judge(now);
            states.as_array_mut().map_inplace(|state| *state = found.next().map_or(0, |one| one as u8));
        }
        states
    }

    fn history(&self, row: usize) -> PyResult<(f64, f64, bool)> {
        let sensor = self.validity.sensors.get(row).ok_or_else(|| bad(format!("row {row} does not exist")))?;
        Ok((sensor.at, sensor.still_for(), sensor.resettled))
    }
}
