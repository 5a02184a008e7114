//! Playout: poses of many sensors, each with its own times, read at one time: interpolated, a little extrapolated, then held.

use super::smooth::along_arc;
use crate::math::{Quat, Vec3};

/// The velocity that is extrapolated is that since a pose at least this much older (s): noise of 1 mm is then 0.05 m/s.
const BASELINE: f64 = 0.020;
/// And at most this: an older pose does not show the velocity now.
const LONGEST: f64 = 0.200;
/// No sensor is further (m) from the origin: such a position is not one.
const FAR: f64 = 1e4;
/// Time of a place that holds nothing.
const EMPTY: f64 = f64::NEG_INFINITY;

/// How a pose was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i8)]
pub enum How {
    Nothing = 0,
    Interpolated = 1,
    Latest = 2,
    Extrapolated = 3,
    Held = 4,
}

/// A pose as it is kept; a part that was not sent is NaN.
#[derive(Clone, Copy, Debug)]
struct Kept {
    time: f64,
    position: Vec3,
    orientation: Quat,
}

/// A place of the buffer that holds no pose.
const NOTHING: Kept = Kept { time: EMPTY, position: [f64::NAN; 3], orientation: [f64::NAN; 4] };

/// What became of a pose that was sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stored {
    Yes,
    /// There was one at that time.
    Repeated,
    /// It is older than all that is kept.
    TooOld,
    /// It is not valid, or the sender has lost the sensor.
    Lost,
}

/// A sensor at one time.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    pub position: Vec3,
    pub orientation: Quat,
    pub valid: bool,
    pub age: f64,
    pub how: How,
    pub time: f64,
}

/// The newest poses of one sensor in the order of their times, from `oldest` on round the ring. extrapolation: how long (s) it
/// moves on with its last velocity.
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

    /// The place of the pose of a rank, from the oldest on.
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

    /// How many places hold a time for which `before` holds, of times in order; empty ones come first.
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

    /// Time of the newest pose, s; minus infinity where there is none.
    pub fn newest(&self) -> f64 {
        self.at_rank(self.ring.len() - 1).time
    }

    /// Take a pose of a time, s. A part that is NaN throughout was not sent; any other that is not whole makes the pose invalid.
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
    pub fn latest(&mut self, now: f64) -> Shown {
        let pose = *self.at_rank(self.ring.len() - 1);
        let how = if now - pose.time <= self.extrapolation { How::Latest } else { How::Held };
        self.show(pose, how, now, now)
    }

    /// The pose at a time `at`, s, that is not after `now`.
    pub fn read(&mut self, at: f64, now: f64) -> Shown {
        let before = self.count(|time| time <= at);
        let (pose, how) = if before == self.ring.len() {
            self.beyond(at)
        } else if before == 0 || self.at_rank(before - 1).time == EMPTY {
            (*self.at_rank(before), How::Latest) // playing has not reached the first pose
        } else {
            (between(self.at_rank(before - 1), self.at_rank(before), at), How::Interpolated)
        };
        self.show(pose, how, at, now)
    }

    /// The pose at a time from that of the newest one on.
    fn beyond(&self, at: f64) -> (Kept, How) {
        let newest = self.at_rank(self.ring.len() - 1);
        let behind = self.count(|time| time <= newest.time - BASELINE);
        let first = if behind == 0 { &NOTHING } else { self.at_rank(behind - 1) };
        let moving = first.time >= newest.time - LONGEST;
        let end = newest.time + self.extrapolation;
        let time = if at < end { at } else { end };
        let how = match () {
            () if time == newest.time => How::Latest,
            () if at > end => How::Held,
            () if moving => How::Extrapolated,
            () => How::Latest,
        };
        (if moving { between(first, newest, time) } else { Kept { time, ..*newest } }, how)
    }

    /// The pose, its quaternion on the side of the one shown last; not valid where none was sent or the sensor is lost.
    fn show(&mut self, pose: Kept, how: How, at: f64, now: f64) -> Shown {
        let cosine: f64 = pose.orientation.iter().zip(self.shown).map(|(x, y)| x * y).sum();
        let sign = if cosine < 0.0 { -1.0 } else { 1.0 };
        self.shown = pose.orientation.map(|x| sign * x);
        let newest = self.newest();
        let known = newest > EMPTY;
        Shown {
            position: pose.position,
            orientation: self.shown,
            valid: known && self.lost_since > at,
            age: (now - newest).max(0.0),
            how: if known { how } else { How::Nothing },
            time: if known { pose.time } else { f64::NAN },
        }
    }
}

/// The pose at a time on the way from a through b, and beyond.
fn between(a: &Kept, b: &Kept, time: f64) -> Kept {
    let share = (time - a.time) / (b.time - a.time);
    Kept {
        time,
        position: std::array::from_fn(|i| a.position[i] + share * (b.position[i] - a.position[i])),
        orientation: along_arc(a.orientation, b.orientation, share),
    }
}
