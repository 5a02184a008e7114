//! Sensors that are watched: which of their poses may be used without a second look, and what is thought of each.

use super::last_poses::{joined, Last, Pose};
use super::sound::{Room, Verdict};
use super::stillness::{Stillness, Times};
use crate::math::{Quat, Vec3};

/// What is thought of one sensor; the rest of what may be thought of it is found elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    Fresh = 0,
    Stale = 1,
    Frozen = 2,
    NotWorn = 5,
    OutOfRange = 6,
}

/// Many sensors by capture time, s. latest: of all captures.
#[derive(Clone, Debug)]
pub struct Watched {
    pub last: Vec<Last>,
    pub latest: f64,
    room: Room,
    times: Times,
    not_worn_after: f64,
    stillness: Stillness,
    outside_at: Vec<f64>,
    began: Option<f64>,
}

impl Watched {
    pub fn new(count: usize, room: Room, times: Times, not_worn_after: f64) -> Self {
        Self {
            last: vec![Last::default(); count],
            latest: f64::NEG_INFINITY,
            room,
            times,
            not_worn_after,
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

    /// Take the sound poses of one capture if none of them needs a second look: all later than any, and near to where they were.
    /// Whether they were taken.
    pub fn take_calm(&mut self, time: f64, sound: impl Iterator<Item = (usize, Vec3, Quat)> + Clone) -> bool {
        let calm = |(row, position, _): (usize, Vec3, Quat)| self.last[row].is_calm(position);
        if time <= self.latest || !sound.clone().all(calm) {
            return false;
        }
        for (row, position, orientation) in sound {
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

    /// What is thought of every sensor at `now`, s.
    pub fn judge(&mut self, now: f64) -> impl Iterator<Item = State> + '_ {
        let began = *self.began.get_or_insert(now);
        let now = if now.is_finite() { now } else { f64::INFINITY };
        self.stillness.look(now, self.latest, &self.last);
        let worn_by_now = now - began >= self.not_worn_after;
        let patience = self.times.stale_after;
        let others = self.stillness.frozen.iter().zip(&self.outside_at);
        self.last.iter().zip(others).map(move |(last, (frozen, outside_at))| {
            // A capture that lies far ahead is no more recent than one far back.
            let stale = (now - last.at).abs() > patience;
            match () {
                () if stale && (now - outside_at).abs() <= patience => State::OutOfRange,
                () if stale && worn_by_now && !last.at.is_finite() => State::NotWorn,
                () if stale => State::Stale,
                () if *frozen => State::Frozen,
                () => State::Fresh,
            }
        })
    }
}
