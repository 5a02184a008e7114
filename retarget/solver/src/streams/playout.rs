//! Playout: poses of many sensors, each with its own times, read at one time. They are interpolated, briefly extrapolated, then held.

use super::smooth::along_arc;
use crate::math::{Quat, Vec3};

/// The extrapolated velocity is that since a pose at least this much older (s). Noise of 1 mm is then 0.05 m/s.
const BASELINE: f64 = 0.020;
/// That pose is at most this much older (s), as an older one does not show the present velocity.
const LONGEST: f64 = 0.200;
/// A position farther (m) from the origin is not valid.
const FAR: f64 = 1e4;
/// Time of an empty place.
const EMPTY: f64 = f64::NEG_INFINITY;

/// The method by which a pose was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i8)]
pub enum Provenance {
    Nothing = 0,
    Interpolated = 1,
    Latest = 2,
    Extrapolated = 3,
    Held = 4,
}

/// A stored pose; a part that was not sent is NaN.
#[derive(Clone, Copy, Debug)]
struct Kept {
    time: f64,
    position: Vec3,
    orientation: Quat,
}

/// An empty place of the buffer.
const NOTHING: Kept = Kept { time: EMPTY, position: [f64::NAN; 3], orientation: [f64::NAN; 4] };

/// Result of storing a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    Yes,
    /// There is one of that time.
    Repeated,
    /// It is older than all stored ones.
    TooOld,
    /// It is not valid, or the sender has lost the sensor.
    Lost,
}

/// A sensor at one time.
#[derive(Clone, Copy, Debug)]
pub struct PlayoutPose {
    pub position: Vec3,
    pub orientation: Quat,
    pub valid: bool,
    pub age: f64,
    pub how: Provenance,
    pub time: f64,
}

/// The newest poses of one sensor in the order of their times, from `oldest` on round the ring. extrapolation: time (s) for which it moves
/// on with its last velocity.
#[derive(Clone, Debug)]
pub struct Track {
    ring: Vec<Kept>,
    oldest: usize,
    extrapolation: f64,
    lost_since: f64,
    shown: Quat,
}

impl Track {
    pub fn new(depth: usize, extrapolation: f64) -> Self {
        Self { ring: vec![NOTHING; depth], oldest: 0, extrapolation, lost_since: f64::INFINITY, shown: [0.0; 4] }
    }

    /// Delete every pose.
    pub fn clear(&mut self) {
        self.ring.fill(NOTHING);
        (self.oldest, self.lost_since, self.shown) = (0, f64::INFINITY, [0.0; 4]);
    }

    /// Index of the pose of a rank, from the oldest on.
    fn place(&self, rank: usize) -> usize {
        let place = self.oldest + rank;
        if place < self.ring.len() {
            place
        } else {
            place - self.ring.len()
        }
    }

    fn at_rank(&self, rank: usize) -> &Kept {
        &self.ring[self.place(rank)]
    }

    /// Number of places whose time satisfies `before`, which holds for the first ones only. Empty places come first.
    fn count(&self, before: impl Fn(f64) -> bool) -> usize {
        let (mut low, mut high) = (0, self.ring.len());
        while low < high {
            let middle = (low + high) / 2;
            if before(self.at_rank(middle).time) {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        low
    }

    /// Time of the newest pose, s; minus infinity without one.
    pub fn newest(&self) -> f64 {
        self.at_rank(self.ring.len() - 1).time
    }

    /// Store a pose of a time, s. A part of NaN only was not sent. Any other incomplete part makes the pose invalid.
    pub fn push(&mut self, time: f64, position: Vec3, orientation: Quat, valid: bool) -> Stored {
        let placed = position.iter().all(|x| x.abs() < FAR);
        let turned = orientation.iter().all(|x| x.abs() < 10.0) && orientation.iter().any(|x| x.abs() > 0.1);
        let missing = |part: &[f64]| part.iter().all(|x| x.is_nan());
        let whole = (placed || missing(&position)) && (turned || missing(&orientation));
        if !(valid && whole && (placed || turned)) {
            if time > self.newest() {
                self.lost_since = self.lost_since.min(time);
            }
            return Stored::Lost;
        }
        let norm = orientation.iter().map(|x| x * x).sum::<f64>().sqrt();
        let stored = self.store(Kept { time, position, orientation: orientation.map(|x| x / norm) });
        if time >= self.lost_since {
            self.lost_since = f64::INFINITY;
        }
        stored
    }

    fn store(&mut self, pose: Kept) -> Stored {
        if pose.time > self.newest() {
            let place = self.oldest;
            self.ring[place] = pose;
            self.oldest = self.place(1);
            return Stored::Yes;
        }
        let rank = self.count(|time| time < pose.time);
        if self.at_rank(rank).time == pose.time {
            return Stored::Repeated;
        }
        if rank == 0 {
            return Stored::TooOld;
        }
        for moved in 1..rank {
            let (to, from) = (self.place(moved - 1), self.place(moved));
            self.ring[to] = self.ring[from];
        }
        let place = self.place(rank - 1);
        self.ring[place] = pose;
        Stored::Yes
    }

    /// The newest pose, at `now`.
    pub fn latest(&mut self, now: f64) -> PlayoutPose {
        let pose = *self.at_rank(self.ring.len() - 1);
        let how = if now - pose.time <= self.extrapolation { Provenance::Latest } else { Provenance::Held };
        self.show(pose, how, now, now)
    }

    /// The pose at a time `at`, s, that is not after `now`.
    pub fn read(&mut self, at: f64, now: f64) -> PlayoutPose {
        let before = self.count(|time| time <= at);
        let (pose, how) = if before == self.ring.len() {
            self.beyond(at)
        } else if before == 0 || self.at_rank(before - 1).time == EMPTY {
            (*self.at_rank(before), Provenance::Latest) // playing has not reached the first pose
        } else {
            (between(self.at_rank(before - 1), self.at_rank(before), at), Provenance::Interpolated)
        };
        self.show(pose, how, at, now)
    }

    /// The pose at the time of the newest one, or later.
    fn beyond(&self, at: f64) -> (Kept, Provenance) {
        let newest = self.at_rank(self.ring.len() - 1);
        let behind = self.count(|time| time <= newest.time - BASELINE);
        let first = if behind == 0 { &NOTHING } else { self.at_rank(behind - 1) };
        let moving = first.time >= newest.time - LONGEST;
        let end = newest.time + self.extrapolation;
        let time = if at < end { at } else { end };
        let how = match () {
            () if time == newest.time => Provenance::Latest,
            () if at > end => Provenance::Held,
            () if moving => Provenance::Extrapolated,
            () => Provenance::Latest,
        };
        (if moving { between(first, newest, time) } else { Kept { time, ..*newest } }, how)
    }

    /// The result, with its quaternion in the hemisphere of the last one. It is not valid if no pose was sent or the sensor is lost.
    fn show(&mut self, pose: Kept, how: Provenance, at: f64, now: f64) -> PlayoutPose {
        let cosine: f64 = pose.orientation.iter().zip(self.shown).map(|(x, y)| x * y).sum();
        let sign = if cosine < 0.0 { -1.0 } else { 1.0 };
        self.shown = pose.orientation.map(|x| sign * x);
        let newest = self.newest();
        let known = newest > EMPTY;
        PlayoutPose {
            position: pose.position,
            orientation: self.shown,
            valid: known && self.lost_since > at,
            age: (now - newest).max(0.0),
            how: if known { how } else { Provenance::Nothing },
            time: if known { pose.time } else { f64::NAN },
        }
    }
}

/// The pose at a time on the line from a through b, and beyond.
fn between(a: &Kept, b: &Kept, time: f64) -> Kept {
    let share = (time - a.time) / (b.time - a.time);
    Kept {
        time,
        position: std::array::from_fn(|i| a.position[i] + share * (b.position[i] - a.position[i])),
        orientation: along_arc(a.orientation, b.orientation, share),
    }
}
