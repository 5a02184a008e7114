//! Which sensors repeat one value while others move. A value that stays is suspect only where most of the others change: made
//! motion without noise also stays. Repeats of one capture are no evidence.

use super::last_poses::{Last, Pose};

/// From this share of the time on that makes a sensor frozen, one looks whether others move: they must do so for the rest of it.
const EARLY: f64 = 0.5;
/// Poses are remembered for the last SNAPSHOTS * SNAPSHOT seconds.
const SNAPSHOTS: usize = 8;
const SNAPSHOT: f64 = 0.04;

/// stale_after, frozen_after: s. noticeable: how far another one must have moved, in m and in parts of a unit quaternion, to say
/// that the performer moves.
#[derive(Clone, Copy, Debug)]
pub struct Times {
    pub stale_after: f64,
    pub frozen_after: f64,
    pub noticeable: (f64, f64),
}

/// Watches sensors by capture time.
#[derive(Clone, Debug)]
pub struct Stillness {
    times: Times,
    pub frozen: Vec<bool>,
    snapshots: Vec<[Pose; SNAPSHOTS]>,
    taken: f64,
    next: usize,
    moving_since: f64,
}

impl Stillness {
    pub fn new(count: usize, times: Times) -> Self {
        Self {
            times,
            frozen: vec![false; count],
            snapshots: vec![[[f64::NAN; 7]; SNAPSHOTS]; count],
            taken: f64::NEG_INFINITY,
            next: 0,
            moving_since: f64::INFINITY,
        }
    }

    /// Note the poses of all sensors, from time to time.
    pub fn remember(&mut self, time: f64, last: &[Last]) {
        if (time - self.taken).abs() >= SNAPSHOT {
            for (snapshots, last) in self.snapshots.iter_mut().zip(last) {
                snapshots[self.next] = last.pose;
            }
            self.next = (self.next + 1) % SNAPSHOTS;
            self.taken = time;
        }
    }

    /// Find which sensors are frozen at `now`. latest: of all captures, s.
    pub fn look(&mut self, now: f64, latest: f64, last: &[Last]) {
        let long = self.times.frozen_after;
        let early = latest - EARLY * long;
        let old = |last: &Last| last.changed().0 <= early || last.changed().1 <= early;
        if !last.iter().any(old) {
            self.frozen.fill(false);
            return;
        }
        let newly = |(last, frozen): (&Last, &bool)| last.still_for() >= EARLY * long && !frozen;
        let settled = if last.iter().zip(&self.frozen).any(newly) {
            let moves = self.others_move(now, last);
            self.moving_since = if moves { self.moving_since.min(latest) } else { f64::INFINITY };
            latest - self.moving_since >= (1.0 - EARLY) * long
        } else {
            false
        };
        for (frozen, last) in self.frozen.iter_mut().zip(last) {
            *frozen = last.still_for() >= long && (*frozen || settled);
        }
    }

    /// Whether most of the sensors change, seen from one that does not, and one of them by more than noise.
    fn others_move(&self, now: f64, last: &[Last]) -> bool {
        let recent = |last: &Last| (now - last.at).abs() <= self.times.stale_after;
        let alive = |last: &Last| recent(last) && last.still_for() <= EARLY * self.times.frozen_after;
        let count = |which: &dyn Fn(&Last) -> bool| last.iter().filter(|one| which(one)).count();
        if 2 * count(&alive) < count(&recent) {
            return false;
        }
        let mut moving = last.iter().zip(&self.snapshots).filter(|(last, _)| alive(last));
        moving.any(|(last, snapshots)| snapshots.iter().any(|past| self.is_elsewhere(&last.pose, past)))
    }

    fn is_elsewhere(&self, pose: &Pose, past: &Pose) -> bool {
        let (metres, turn) = self.times.noticeable;
        let moved = (0..3).any(|i| (pose[i] - past[i]).abs() > metres);
        moved || (3..7).any(|i| (pose[i] - past[i]).abs().min((pose[i] + past[i]).abs()) > turn)
    }
}
