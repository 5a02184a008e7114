//! Python bindings of the stream filters: whole frames of all sensors, one call each. See `retarget/_solver.pyi`.

use super::playout::{PlayoutPose, Stored, Track};
use super::sensor_plan::{Column, Parts};
use super::smooth::{Cutoffs, SmoothPose};
use super::validity::{Limits, Sent, Validity, Verdict};
use crate::python::arrays::{bad, entries, indices, matrix, numbers, Flags, Integers, Matrix, Numbers, Table, Vector};
use numpy::{PyArray1, PyReadwriteArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

type Array<'py, T> = Bound<'py, PyArray1<T>>;
type Played<'py> = (Matrix<'py>, Matrix<'py>, Array<'py, bool>, Vector<'py>, Array<'py, i8>, Vector<'py>);

pub fn register(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add_class::<PyPoseFilter>()?;
    m.add_class::<PyPoseRing>()?;
    m.add_class::<PySensorPlan>()?;
    m.add_class::<PyPoseParts>()?;
    m.add_class::<PyValidity>()
}

/// Filters the poses of many sensors.
#[pyclass(name = "PoseFilter", module = "retarget._solver")]
struct PyPoseFilter {
    poses: Vec<SmoothPose>,
    position: Option<Cutoffs>,
    orientation: Option<Cutoffs>,
}

fn cutoffs((least, per_speed, of_speed): (f64, f64, f64)) -> PyResult<Cutoffs> {
    if ![least, per_speed, of_speed].iter().all(|v| v.is_finite()) || least <= 0.0 || per_speed < 0.0 || of_speed <= 0.0
    {
        return Err(bad("cutoffs of a filter are finite, positive numbers".into()));
    }
    Ok(Cutoffs { least, per_speed, of_speed })
}

#[pymethods]
impl PyPoseFilter {
    #[new]
    #[pyo3(signature = (count, *, position, orientation))]
    fn new(count: usize, position: Option<(f64, f64, f64)>, orientation: Option<(f64, f64, f64)>) -> PyResult<Self> {
        let (position, orientation) = (position.map(cutoffs).transpose()?, orientation.map(cutoffs).transpose()?);
        Ok(Self { poses: vec![SmoothPose::default(); count], position, orientation })
    }

    fn step<'py>(
        &mut self,
        py: Python<'py>,
        time: Numbers<'py>,
        position: Table<'py>,
        orientation: Table<'py>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>)> {
        let count = self.poses.len();
        let time = entries(&time, count, "time")?;
        let mut places = numbers(&position, count, "position")?.to_vec();
        let mut turns = numbers(&orientation, count, "orientation")?.to_vec();
        for (((pose, time), place), turn) in self.poses.iter_mut().zip(time).zip(&mut places).zip(&mut turns) {
            *place = self.position.map_or(*place, |cutoffs| pose.step_position(&cutoffs, *time, *place));
            *turn = self.orientation.map_or(*turn, |cutoffs| pose.step_orientation(&cutoffs, *time, *turn));
        }
        Ok((matrix(py, &places)?, matrix(py, &turns)?))
    }

    fn reset(&mut self, rows: Flags<'_>) -> PyResult<()> {
        let rows = entries(&rows, self.poses.len(), "rows")?;
        for (pose, gone) in self.poses.iter_mut().zip(rows) {
            if *gone {
                *pose = SmoothPose::default();
            }
        }
        Ok(())
    }
}

/// A playout buffer.
#[pyclass(name = "PoseRing", module = "retarget._solver")]
struct PyPoseRing {
    tracks: Vec<Track>,
}

#[pymethods]
impl PyPoseRing {
    #[new]
    #[pyo3(signature = (count, *, depth, extrapolation))]
    fn new(count: usize, depth: usize, extrapolation: f64) -> PyResult<Self> {
        if count == 0 || depth < 2 {
            return Err(bad(format!("a ring has 1 sensor and 2 poses at least; found {count} and {depth}")));
        }
        Ok(Self { tracks: vec![Track::new(depth, extrapolation); count] })
    }

    fn push(
        &mut self,
        rows: Integers<'_>,
        time: f64,
        position: Table<'_>,
        orientation: Table<'_>,
        valid: Flags<'_>,
    ) -> PyResult<(Option<f64>, u32, u32)> {
        let rows = indices(&rows, self.tracks.len())?;
        let (position, orientation) =
            (numbers(&position, rows.len(), "position")?, numbers(&orientation, rows.len(), "orientation")?);
        let valid = entries(&valid, rows.len(), "valid")?;
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
        self.played(py, |track| track.latest(now))
    }

    fn read<'py>(&mut self, py: Python<'py>, at: f64, now: f64) -> PyResult<Played<'py>> {
        self.played(py, |track| track.read(at, now))
    }

    fn clear(&mut self) {
        self.tracks.iter_mut().for_each(Track::clear);
    }
}

impl PyPoseRing {
    fn played<'py>(&mut self, py: Python<'py>, read: impl FnMut(&mut Track) -> PlayoutPose) -> PyResult<Played<'py>> {
        let shown: Vec<PlayoutPose> = self.tracks.iter_mut().map(read).collect();
        let positions: Vec<_> = shown.iter().map(|one| one.position).collect();
        let orientations: Vec<_> = shown.iter().map(|one| one.orientation).collect();
        Ok((
            matrix(py, &positions)?,
            matrix(py, &orientations)?,
            PyArray1::from_iter(py, shown.iter().map(|one| one.valid)),
            PyArray1::from_iter(py, shown.iter().map(|one| one.age)),
            PyArray1::from_iter(py, shown.iter().map(|one| one.how as i8)),
            PyArray1::from_iter(py, shown.iter().map(|one| one.time)),
        ))
    }
}

/// Sensors out of the poses of a sender.
#[pyclass(name = "SensorPlan", module = "retarget._solver", frozen)]
struct PySensorPlan {
    count: usize,
    columns: Vec<Column>,
}

fn column(index: i64, count: usize) -> PyResult<Option<usize>> {
    match usize::try_from(index) {
        Ok(index) if index < count => Ok(Some(index)),
        Ok(_) => Err(bad(format!("column {index} does not exist; there are {count}"))),
        Err(_) => Ok(None),
    }
}

#[pymethods]
impl PySensorPlan {
    #[new]
    fn new(
        count: usize,
        points: Integers<'_>,
        segments: Integers<'_>,
        turn: Table<'_>,
        offset: Table<'_>,
    ) -> PyResult<Self> {
        let points = points.as_slice()?;
        let segments = entries(&segments, points.len(), "segments")?;
        let (turn, offset) = (numbers(&turn, points.len(), "turn")?, numbers(&offset, points.len(), "offset")?);
        let columns = (0..points.len()).map(|i| {
            Ok(Column {
                point: column(points[i], count)?,
                segment: column(segments[i], count)?,
                turn: turn[i],
                offset: (offset[i] != [0.0; 3]).then_some(offset[i]),
            })
        });
        Ok(Self { count, columns: columns.collect::<PyResult<_>>()? })
    }

    fn read<'py>(
        &self,
        py: Python<'py>,
        position: Table<'py>,
        orientation: Table<'py>,
        tracked: Flags<'py>,
    ) -> PyResult<(Matrix<'py>, Matrix<'py>, Array<'py, bool>)> {
        let (position, orientation) =
            (numbers(&position, self.count, "position")?, numbers(&orientation, self.count, "orientation")?);
        let tracked = entries(&tracked, self.count, "tracked")?;
        let places: Vec<_> = self.columns.iter().map(|column| column.place(position, orientation)).collect();
        let turns: Vec<_> = self.columns.iter().map(|column| column.turn(orientation)).collect();
        let marks = self.columns.iter().map(|column| column.point.or(column.segment).is_some_and(|at| tracked[at]));
        Ok((matrix(py, &places)?, matrix(py, &turns)?, PyArray1::from_iter(py, marks)))
    }
}

#[pyclass(name = "PoseParts", module = "retarget._solver")]
struct PyPoseParts {
    parts: Vec<Parts>,
}

#[pymethods]
impl PyPoseParts {
    #[new]
    fn new(count: usize) -> Self {
        Self { parts: vec![Parts::default(); count] }
    }

    fn complete(
        &mut self,
        rows: Integers<'_>,
        time: f64,
        mut position: PyReadwriteArray2<'_, f64>,
        mut orientation: PyReadwriteArray2<'_, f64>,
    ) -> PyResult<()> {
        let rows = indices(&rows, self.parts.len())?;
        if position.shape() != [rows.len(), 3] || orientation.shape() != [rows.len(), 4] {
            return Err(bad(format!("poses of {} sensors are (k, 3) and (k, 4)", rows.len())));
        }
        let places = position.as_slice_mut()?.as_chunks_mut::<3>().0;
        let turns = orientation.as_slice_mut()?.as_chunks_mut::<4>().0;
        for ((row, place), turn) in rows.iter().zip(places).zip(turns) {
            (*place, *turn) = self.parts[*row as usize].complete(time, *place, *turn);
        }
        Ok(())
    }
}

/// Sensor validity.
#[pyclass(name = "Validity", module = "retarget._solver")]
struct PyValidity {
    validity: Validity,
}

#[pymethods]
impl PyValidity {
    #[new]
    fn new(others: Integers<'_>, limits: Limits) -> PyResult<Self> {
        let count = others.len();
        let others = others.as_slice()?.iter().map(|other| column(*other, count));
        Ok(Self { validity: Validity::new(others.collect::<PyResult<_>>()?, limits) })
    }

    fn take<'py>(
        &mut self,
        py: Python<'py>,
        rows: Integers<'py>,
        time: f64,
        position: Table<'py>,
        orientation: Table<'py>,
        tracked: Flags<'py>,
    ) -> PyResult<Option<Array<'py, u8>>> {
        let rows = indices(&rows, self.validity.sensors.len())?;
        let (position, orientation) =
            (numbers(&position, rows.len(), "position")?, numbers(&orientation, rows.len(), "orientation")?);
        let tracked = entries(&tracked, rows.len(), "tracked")?;
        let sent = |(i, row): (usize, &i64)| Sent {
            row: *row as usize,
            position: position[i],
            orientation: orientation[i],
            tracked: tracked[i],
        };
        let capture: Vec<Sent> = rows.iter().enumerate().map(sent).collect();
        let verdicts = self.validity.take(time, &capture);
        let any_wrong = verdicts.iter().any(|verdict| *verdict != Verdict::Valid);
        Ok(any_wrong.then(|| PyArray1::from_iter(py, verdicts.iter().map(|verdict| *verdict as u8))))
    }

    fn judge<'py>(&mut self, py: Python<'py>, now: f64) -> Array<'py, u8> {
        PyArray1::from_vec(py, self.validity.judge(now).map(|state| state as u8).collect())
    }

    fn history(&self, row: usize) -> PyResult<(f64, f64, bool)> {
        let sensor = self.validity.sensors.get(row).ok_or_else(|| bad(format!("row {row} does not exist")))?;
        Ok((sensor.at, sensor.still_for(), sensor.resettled))
    }
}
