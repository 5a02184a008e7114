//! Watched sensors: which of their poses need no further check, and the state of each sensor.

use super::last_poses::{joined, Last, Pose};
use super::pose_check::{Room, Verdict};
use super::stillness::{Stillness, Times};
use crate::math::{Quat, Vec3};

/// The state of one sensor. `ValidityState` in Python has more states, which this crate does not find.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    Fresh = 0,
    Stale = 1,
    Frozen = 2,
    NotInUse = 5,
    OutOfRange = 6,
}

/// Many sensors by capture time, s. latest: of all captures.
#[derive(Clone, Debug)]
pub struct Watched {
    pub last: Vec<Last>,
    pub latest: f64,
    room: Room,
    times: Times,
    not_in_use_after: f64,
    stillness: Stillness,
    outside_at: Vec<f64>,
    began: Option<f64>,
}

impl Watched {
    pub fn new(count: usize, room: Room, times: Times, not_in_use_after: f64) -> Self {
        Self {
            last: vec![Last::default(); count],
            latest: f64::NEG_INFINITY,
            room,
            times,
            not_in_use_after,
            stillness: Stillness::new(count, times),
            outside_at: vec![f64::NEG_INFINITY; count],
            began: None,
        }
    }

    /// Judge a pose of a capture by itself.
    pub fn verdict(&mut self, row: usize, time: f64, position: Vec3, orientation: Quat, tracked: bool) -> Verdict {
        let verdict = self.room.judge(position, orientation, tracked);
        if verdict == Verdict::OutOfRange {
            self.outside_at[row] = time;
        }
        verdict
    }

    /// Take the valid poses of one capture if none of them needs a further check: all later than any before, and near to where the
    /// sensors were. Returns whether they were taken.
    pub fn take_calm(&mut self, time: f64, valid: impl Iterator<Item = (usize, Vec3, Quat)> + Clone) -> bool {
        let calm = |(row, position, _): (usize, Vec3, Quat)| self.last[row].is_calm(position);
        if time <= self.latest || !valid.clone().all(calm) {
            return false;
        }
        for (row, position, orientation) in valid {
            self.last[row].put(time, joined(position, orientation));
            if orientation[0].is_nan() {
                self.last[row].forget_turn();
            }
        }
        self.latest = time;
        self.stillness.remember(time, &self.last);
        true
    }

    /// Take any poses of one capture.
    pub fn put(&mut self, time: f64, poses: impl Iterator<Item = (usize, Pose)>) {
        let mut any = false;
        for (row, pose) in poses {
            self.last[row].put(time, pose);
            any = true;
        }
        if any {
            self.latest = self.last.iter().map(|last| last.at).fold(f64::NEG_INFINITY, f64::max);
        }
        self.stillness.remember(time, &self.last);
    }

    /// The state of every sensor at `now`, s.
    pub fn judge(&mut self, now: f64) -> impl Iterator<Item = State> + '_ {
        let began = *self.began.get_or_insert(now);
        let now = if now.is_finite() { now } else { f64::INFINITY };
        self.stillness.look(now, self.latest, &self.last);
        let expected_by_now = now - began >= self.not_in_use_after;
        let patience = self.times.stale_after;
        let others = self.stillness.frozen.iter().zip(&self.outside_at);
        self.last.iter().zip(others).map(move |(last, (frozen, outside_at))| {
            // A capture far in the future is no more recent than one far back.
            let stale = (now - last.at).abs() > patience;
            match () {
                () if stale && (now - outside_at).abs() <= patience => State::OutOfRange,
                () if stale && expected_by_now && !last.at.is_finite() => State::NotInUse,
                () if stale => State::Stale,
                () if *frozen => State::Frozen,
                () => State::Fresh,
            }
        })
    }
}
