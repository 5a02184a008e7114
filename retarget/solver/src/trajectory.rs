//! Online trajectory generation for slow moves in joint space, with limits of velocity, acceleration and jerk. Joints arrive
//! together, and target and speed override may change in every tick.
//!
//! A reference point goes straight towards the target, all joints in proportion, the slowest at its limit of velocity. The
//! position is that point averaged over the last `n1` ticks, and this average averaged over `n2` (a cascade of moving
//! averages: Biagiotti and Melchiorri, "FIR filters for online trajectory planning with time- and frequency-domain
//! specifications", Control Engineering Practice 20, 2012). Every joint has the same filter, so
//!
//! * a move from rest to rest is a straight line, and ends exactly at the target after a finite time;
//! * from rest, the position never leaves the convex hull of the start and of the targets so far: nothing overshoots;
//! * velocity is an average of the reference's own, and thus within its limits. An average over n1 dt >= v / a changes it
//!   by at most a, and one over n2 dt >= 2 a / j changes the acceleration, between -a and a, by at most j.
//!
//! A move takes distance / v + v / a + 2 a / j, where the time-optimal one takes distance / v + v / a + a / j.

/// The longest average, in ticks: memory and work per tick grow with it.
const LONGEST: f64 = 10_000.0;
/// A target counts as at most this far away, rad, so that its distance stays finite.
const FAR: f64 = 1e300;
/// Rounding, as a share of a limit and of a tick.
const ROUNDING: f64 = 1e-9;

/// Limits of one joint: rad/s, rad/s^2, rad/s^3.
#[derive(Clone, Copy, Debug)]
pub struct MotionLimit {
    pub velocity: f64,
    pub acceleration: f64,
    pub jerk: f64,
}

/// Joints in motion. Displacements are of one tick, in rad; windows hold rows of one displacement for each joint, the newest first.
#[derive(Clone, Debug)]
pub struct TrajectoryGenerator {
    limits: Vec<MotionLimit>,
    dt: f64,
    /// Ticks of both averages.
    n1: usize,
    n2: usize,
    /// Most that a displacement of the reference may differ from that of n1 ticks ago, by the limit of acceleration, (n,).
    room: Vec<f64>,
    /// The point that goes straight towards the target, (n,).
    reference: Vec<f64>,
    /// Its last displacements (n1, n), and those of its average (n2, n).
    moved: Vec<f64>,
    averaged: Vec<f64>,
    target: Vec<f64>,
    pub position: Vec<f64>,
    pub velocity: Vec<f64>,
    pub acceleration: Vec<f64>,
}

impl TrajectoryGenerator {
    /// Limits and dt are positive. All else is unknown (NaN) before the first `reset`. Err: an average would be too long.
    pub fn new(limits: Vec<MotionLimit>, dt: f64) -> Result<Self, String> {
        let ticks = |time: fn(&MotionLimit) -> f64, what: &str| {
            let longest = limits.iter().map(time).fold(0.0, f64::max) / dt;
            let ticks = (longest * (1.0 - ROUNDING)).ceil().max(1.0);
            (ticks <= LONGEST)
                .then_some(ticks as usize)
                .ok_or(format!("{what} takes {ticks:.0} ticks of {dt} s, at most {LONGEST} are possible"))
        };
        let n1 = ticks(|l| l.velocity / l.acceleration, "max_velocity / max_acceleration")?;
        let n2 = ticks(|l| 2.0 * l.acceleration / l.jerk, "2 max_acceleration / max_jerk")?;
        let n = limits.len();
        let room = limits.iter().map(|l| l.acceleration * dt * dt * n1 as f64 * (1.0 + ROUNDING)).collect();
        let unknown = vec![f64::NAN; n];
        Ok(Self {
            limits,
            dt,
            n1,
            n2,
            room,
            reference: unknown.clone(),
            moved: vec![0.0; n1 * n],
            averaged: vec![0.0; n2 * n],
            target: unknown.clone(),
            position: unknown.clone(),
            velocity: unknown.clone(),
            acceleration: unknown,
        })
    }

    pub fn joints(&self) -> usize {
        self.limits.len()
    }

    /// Go on from a state. Its acceleration fades out within `n2` ticks, unless the target needs it longer.
    pub fn reset(&mut self, position: &[f64], velocity: &[f64], acceleration: &[f64]) {
        let n = self.joints();
        self.target.copy_from_slice(position);
        self.position.copy_from_slice(position);
        self.velocity.copy_from_slice(velocity);
        self.acceleration.copy_from_slice(acceleration);
        for i in 0..n {
            // A past with this velocity and acceleration: the velocity of the first average rose steadily, and the reference
            // has the velocity that this average has reached.
            let change = acceleration[i] * self.dt * self.dt;
            let newest = velocity[i] * self.dt + change * (self.n2 - 1) as f64 / 2.0;
            (0..self.n1).for_each(|row| self.moved[row * n + i] = newest);
            (0..self.n2).for_each(|row| self.averaged[row * n + i] = newest - change * row as f64);
            self.reference[i] = position[i] + self.reference_offset(i);
        }
    }

    /// One tick towards rest at `target` (n,), finite; the limits of velocity are scaled by `speed_override`, 0 to 1.
    pub fn step(&mut self, target: &[f64], speed_override: f64) {
        let n = self.joints();
        self.target.copy_from_slice(target);
        self.move_reference(speed_override);
        self.averaged.copy_within(..(self.n2 - 1) * n, n);
        for i in 0..n {
            self.averaged[i] = mean(&self.moved[i..], n, self.n1);
            let velocity = mean(&self.averaged[i..], n, self.n2) / self.dt;
            self.acceleration[i] = (velocity - self.velocity[i]) / self.dt;
            self.velocity[i] = velocity;
            self.position[i] = self.reference[i] - self.reference_offset(i);
        }
    }

    /// Distance of the reference ahead of the position of joint i, which the averages still have to pass on.
    fn reference_offset(&self, i: usize) -> f64 {
        let n = self.joints();
        let ahead = |window: &[f64], length: usize| -> f64 {
            (0..length).map(|row| window[row * n + i] * ((length - 1 - row) as f64 / length as f64)).sum()
        };
        ahead(&self.moved, self.n1) + ahead(&self.averaged, self.n2)
    }

    /// One tick of the reference.
    fn move_reference(&mut self, speed_override: f64) {
        let (n, dt) = (self.joints(), self.dt);
        // Ticks that the slowest joint needs at full speed.
        let ticks = (0..n).map(|i| self.remaining(i).abs() / (self.limits[i].velocity * dt)).fold(0.0, f64::max);
        let share = if ticks <= speed_override { 1.0 } else { speed_override / ticks };
        // The row of the oldest displacements becomes that of the newest.
        self.moved.rotate_right(n);
        // Zero is always within the room about an old displacement, so all joints together can go slower until each is
        // within its own. Joints that started too fast brake by themselves.
        let mut slower = 1.0_f64;
        for i in 0..n {
            let (requested, old, room) = (share * self.remaining(i), self.moved[i], self.room[i]);
            let most = room + old * requested.signum();
            if old.abs() <= room && requested.abs() > most {
                slower = slower.min(most / requested.abs());
            }
        }
        for i in 0..n {
            let (requested, old, room) = (slower * share * self.remaining(i), self.moved[i], self.room[i]);
            let moved = if old.abs() <= room { requested } else { requested.clamp(old - room, old + room) };
            self.moved[i] = moved;
            let arrived = slower * share == 1.0 && moved == requested;
            self.reference[i] = if arrived { self.target[i] } else { self.reference[i] + moved };
        }
    }

    /// Distance from the reference of joint i to the target.
    fn remaining(&self, i: usize) -> f64 {
        (self.target[i] - self.reference[i]).clamp(-FAR, FAR)
    }

    /// True if all joints stand exactly at the target.
    pub fn at_rest(&self) -> bool {
        self.reference == self.target && self.moved.iter().chain(&self.averaged).all(|moved| *moved == 0.0)
    }
}

/// Mean of `length` entries of `window`, every n-th.
fn mean(window: &[f64], n: usize, length: usize) -> f64 {
    window.iter().step_by(n).take(length).sum::<f64>() / length as f64
}
