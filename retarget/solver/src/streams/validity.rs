//! Sensor validity: a verdict on each pose, and the state of each sensor.
//!
//! A pose is judged by itself (finite, a rotation, inside the room, tracked by the sender) and by the speed from the last accepted
//! pose of its sensor. A sensor is stale if that pose is old, has jumped if it stays at an impossible place, and is frozen if it
//! repeats one value while the others move. Every limit comes from `retarget.human.pose_validation.ValidityLimits`.

use crate::math::{norm, square, sub, Quat, Vec3};

/// Numbers within this (m, parts of a unit quaternion) are the same. An orientation that was composed of others in float32 varies by
/// 3e-7. The noise of inertial sensors exceeds this within one sample, that of optical ones by far.
const SAME: f64 = 1e-6;
/// Ratio of the distances below which a place is much nearer to one point than to another.
const MUCH_NEARER: f64 = 0.35;

/// Lengths in m, times in s of capture; see `ValidityLimits`, whose fields these are.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "python", derive(pyo3::FromPyObject))]
pub struct Limits {
    pub fastest: f64,
    pub shortest_step: f64,
    pub swap: f64,
    pub hardest: f64,
    pub settled_after: f64,
    pub back_within: f64,
    pub stale_after: f64,
    pub frozen_after: f64,
    pub noticeable: (f64, f64),
    pub not_in_use_after: f64,
    pub reach: f64,
    pub low: f64,
    pub high: f64,
    pub norm_tolerance: f64,
}

/// The verdict on one pose; the first that applies. `REASONS` in Python.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Verdict {
    Valid = 0,
    Untracked = 1,
    NotFinite = 2,
    NotARotation = 3,
    OutOfRange = 4,
    Unreachable = 5,
}

/// The state of one sensor. `ValidityState` in Python.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    Fresh = 0,
    Stale = 1,
    Frozen = 2,
    Jumped = 3,
    NotInUse = 4,
    OutOfRange = 5,
}

/// A pose of one sensor: its row, position (m), orientation wxyz (NaN if it has none), and the sender's mark of tracking.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    pub row: usize,
    pub position: Vec3,
    pub orientation: Quat,
    pub tracked: bool,
}

/// A sensor at a place that no human can have reached: its last place there, the time of that, and the time since which it moves on
/// from there. swapped: number of poses at the place of its other side, of which two are a swap at once. Other poses there are only
/// dropped until the last accepted pose of the sensor is old, as most jumps come back.
#[derive(Clone, Copy, Debug)]
struct Jump {
    place: Vec3,
    last: f64,
    since: f64,
    swapped: u32,
}

/// One sensor. position, orientation, at: the last accepted pose and its time. place_changed, turn_changed: times of the last changes,
/// NaN if an orientation never changed. mark, marked: the pose from which noticeable motion is measured, and the time when it was last
/// left. resettled: true if the last jump ended at its new place.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    position: Vec3,
    orientation: Quat,
    pub at: f64,
    place_changed: f64,
    turn_changed: f64,
    mark: (Vec3, Quat),
    marked: f64,
    jump: Option<Jump>,
    pub resettled: bool,
    outside_at: f64,
    frozen: bool,
}

const UNKNOWN: Sensor = Sensor {
    position: [f64::NAN; 3],
    orientation: [f64::NAN; 4],
    at: f64::NEG_INFINITY,
    place_changed: f64::NAN,
    turn_changed: f64::NAN,
    mark: ([f64::NAN; 3], [f64::NAN; 4]),
    marked: f64::NEG_INFINITY,
    jump: None,
    resettled: false,
    outside_at: f64::NEG_INFINITY,
    frozen: false,
};

impl Sensor {
    /// Time of the last change of its value, s: of the orientation, if that ever changed, else of the position. A lost tracker of a chain
    /// keeps its orientation while its position is carried along.
    fn changed(&self) -> f64 {
        if self.turn_changed.is_nan() {
            self.place_changed
        } else {
            self.turn_changed
        }
    }

    /// Time for which it has repeated its value, s.
    pub fn still_for(&self) -> f64 {
        self.at - self.changed()
    }

    fn accept(&mut self, time: f64, sent: &Sent, noticeable: (f64, f64)) {
        let (metres, turn) = noticeable;
        let known = self.position[0].is_finite();
        if !known || differ(&sent.position, &self.position, SAME) {
            self.place_changed = time;
        }
        if sent.orientation[0].is_nan() {
            self.turn_changed = f64::NAN;
        } else if differ(&sent.orientation, &self.orientation, SAME) {
            self.turn_changed = time;
        }
        let opposite = sent.orientation.map(|x| -x);
        let turned = differ(&sent.orientation, &self.mark.1, turn) && differ(&opposite, &self.mark.1, turn);
        if !known {
            self.mark = (sent.position, sent.orientation);
        } else if turned || differ(&sent.position, &self.mark.0, metres) {
            (self.mark, self.marked) = ((sent.position, sent.orientation), time);
        }
        (self.position, self.orientation, self.at) = (sent.position, sent.orientation, time);
    }
}

/// True if a number differs by more than `least`; false for NaN.
fn differ<const N: usize>(a: &[f64; N], b: &[f64; N], least: f64) -> bool {
    a.iter().zip(b).any(|(x, y)| (x - y).abs() > least)
}

/// The sensors of a performer. others: the sensor of the other side of each, if it has one.
#[derive(Clone, Debug)]
pub struct Validity {
    pub sensors: Vec<Sensor>,
    others: Vec<Option<usize>>,
    limits: Limits,
    moving_since: f64,
    began: Option<f64>,
}

impl Validity {
    pub fn new(others: Vec<Option<usize>>, limits: Limits) -> Self {
        let sensors = vec![UNKNOWN; others.len()];
        Self { sensors, others, limits, moving_since: f64::INFINITY, began: None }
    }

    /// Judge the poses of one capture, each of another sensor, and store the accepted ones.
    pub fn take(&mut self, time: f64, capture: &[Sent]) -> Vec<Verdict> {
        let mut verdicts: Vec<_> = capture.iter().map(|sent| self.alone(sent)).collect();
        let reach = |sent: &Sent| self.reach(time, sent, capture);
        let reaches: Vec<f64> = capture.iter().map(reach).collect();
        for ((sent, reach), verdict) in capture.iter().zip(reaches).zip(&mut verdicts) {
            match verdict {
                Verdict::Valid if self.is_reached(time, sent, reach) => {}
                Verdict::Valid => *verdict = Verdict::Unreachable,
                Verdict::OutOfRange => self.sensors[sent.row].outside_at = time,
                _ => {}
            }
        }
        verdicts
    }

    /// The verdict on a pose by itself. It needs a position; an orientation may be missing.
    fn alone(&self, sent: &Sent) -> Verdict {
        let limits = &self.limits;
        let missing = sent.orientation.iter().all(|x| x.is_nan());
        let norm = sent.orientation.iter().map(|x| x * x).sum::<f64>().sqrt();
        let [x, y, z] = sent.position;
        let turn_is_finite = missing || sent.orientation.iter().all(|x| x.is_finite());
        match () {
            () if !sent.tracked => Verdict::Untracked,
            () if !(turn_is_finite && sent.position.iter().all(|x| x.is_finite())) => Verdict::NotFinite,
            () if !missing && (norm - 1.0).abs() > limits.norm_tolerance => Verdict::NotARotation,
            () if x.abs() > limits.reach || y.abs() > limits.reach => Verdict::OutOfRange,
            () if !(limits.low..=limits.high).contains(&z) => Verdict::OutOfRange,
            () => Verdict::Valid,
        }
    }

    fn by_speed(&self, elapsed: f64) -> f64 {
        self.limits.fastest * elapsed.max(self.limits.shortest_step)
    }

    /// Most distance of a sensor from its last accepted pose, m, by the speed of the fastest human. A sensor that is reported at the place of
    /// its other side, while that one is not there, is bounded by the hardest movement from rest.
    fn reach(&self, time: f64, sent: &Sent, capture: &[Sent]) -> f64 {
        let limits = &self.limits;
        let own = &self.sensors[sent.row];
        let elapsed = time - own.at;
        let Some(row) = self.others[sent.row] else { return self.by_speed(elapsed) };
        let other = &self.sensors[row];
        // Comparisons with NaN, for a place that is not known, are false.
        let nearer = |p: Vec3, to: Vec3, than: Vec3| norm(sub(p, to)) <= MUCH_NEARER * norm(sub(p, than));
        let left_its_own = match capture.iter().find(|sent| sent.row == row && sent.position[0].is_finite()) {
            Some(sent) => nearer(sent.position, own.position, other.position),
            None => time - other.at <= limits.back_within,
        };
        if left_its_own && nearer(sent.position, other.position, own.position) {
            limits.swap + 0.5 * limits.hardest * square(elapsed.min(limits.back_within))
        } else {
            self.by_speed(elapsed)
        }
    }

    /// True if a human can have moved a sensor to a place within `reach`, m. The pose is stored if it is the newest.
    fn is_reached(&mut self, time: f64, sent: &Sent, reach: f64) -> bool {
        let limits = self.limits;
        let sensor = &self.sensors[sent.row];
        let (elapsed, away) = (time - sensor.at, norm(sub(sent.position, sensor.position)));
        let at_other = u32::from(reach < self.by_speed(elapsed));
        let is_late = |elapsed: f64| (-limits.settled_after..=0.0).contains(&elapsed);
        let mut jump = match sensor.jump {
            Some(jump) if is_late(time - jump.last) => return false,
            // A pose older than the last one, or repeated: it may be used, but is not the last accepted pose.
            None if is_late(elapsed) => return away <= self.by_speed(0.0),
            None if elapsed > 0.0 && away > reach => Jump { place: sent.position, last: time, since: time, swapped: 0 },
            // A clock that was set back starts anew, and so does a new sensor.
            None => return self.accept(time, sent, false),
            Some(jump) => jump,
        };
        if time > jump.last {
            let (gap, on) = (time - jump.last, norm(sub(sent.position, jump.place)));
            let soon = (time - jump.since).min(limits.back_within);
            // It jumps back. Walking through its old place is no jump.
            if on > limits.swap && away < 0.5 * on && away <= self.by_speed(soon) {
                return self.accept(time, sent, false);
            }
            if gap > limits.stale_after || on > self.by_speed(gap) {
                jump.since = time;
            }
            (jump.place, jump.last) = (sent.position, time);
            if time - jump.since >= limits.settled_after {
                return self.accept(time, sent, true);
            }
        } else if sensor.jump.is_some() {
            (jump.place, jump.last, jump.since) = (sent.position, time, time);
        }
        jump.swapped = jump.swapped.saturating_add(at_other);
        self.sensors[sent.row].jump = Some(jump);
        false
    }

    fn accept(&mut self, time: f64, sent: &Sent, resettled: bool) -> bool {
        let sensor = &mut self.sensors[sent.row];
        if sensor.jump.take().is_some() {
            sensor.resettled = resettled;
        }
        sensor.accept(time, sent, self.limits.noticeable);
        true
    }

    /// The state of every sensor at `now`, s.
    pub fn judge(&mut self, now: f64) -> impl Iterator<Item = State> + '_ {
        let began = *self.began.get_or_insert(now);
        let now = if now.is_finite() { now } else { f64::INFINITY };
        self.find_frozen(now);
        let limits = self.limits;
        // A capture far in the future is no more recent than one far back.
        let recent = move |time: f64| (now - time).abs() <= limits.stale_after;
        self.sensors.iter().map(move |sensor| match sensor.jump {
            Some(jump) if recent(jump.last) && (jump.swapped > 1 || !recent(sensor.at)) => State::Jumped,
            _ if !recent(sensor.at) && recent(sensor.outside_at) => State::OutOfRange,
            _ if recent(sensor.at) && sensor.frozen => State::Frozen,
            _ if recent(sensor.at) => State::Fresh,
            _ if now - began >= limits.not_in_use_after && !sensor.at.is_finite() => State::NotInUse,
            _ => State::Stale,
        })
    }

    /// Find frozen sensors, which repeat their value for `frozen_after` s in which the others move. Only then is a constant value suspect,
    /// as synthetic motion without noise also rests. Repeats of one capture are no evidence.
    fn find_frozen(&mut self, now: f64) {
        let long = self.limits.frozen_after;
        let latest = self.sensors.iter().map(|sensor| sensor.at).fold(f64::NEG_INFINITY, f64::max);
        self.moving_since = if self.others_move(now) { self.moving_since.min(latest) } else { f64::INFINITY };
        for sensor in &mut self.sensors {
            let still = sensor.still_for() >= long;
            sensor.frozen = still && (sensor.frozen || latest - self.moving_since >= long);
        }
    }

    /// True if at least half of the recent sensors change, and one of them by more than noise.
    fn others_move(&self, now: f64) -> bool {
        let limits = &self.limits;
        let recent = self.sensors.iter().filter(|sensor| (now - sensor.at).abs() <= limits.stale_after);
        let changing = recent.clone().filter(|sensor| sensor.still_for() <= 0.5 * limits.frozen_after);
        2 * changing.clone().count() >= recent.count()
            && changing.clone().any(|sensor| sensor.at - sensor.marked <= limits.frozen_after)
    }
}
