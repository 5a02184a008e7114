//! Whether a path of postures keeps every pair apart, between its rows too.
//!
//! Two convex solids are at least as far apart as along any one direction. Held in the frame that both sides hang on, that
//! separation is, for every pair of their points, a smooth function of the joints: between the ends of a stretch it is below both
//! of its ends by no more than the stretch bends (`Stretch::bend`). What that does not prove is halved.

use super::law::{BETWEEN, LET_OUT};
use super::set::ObserverSet;
use super::stage::Stage;
use super::way::{Arm, Arms, Stretch, Way};
use crate::body::Body;
use crate::math::Vec3;
use std::sync::Arc;

/// Stretches shorter than this share of a row are not halved: what is not proven by then is not clear.
const LEAST_PART: f64 = 1.0 / 256.0;
/// Postures of one path that are looked at, for the same reason, where the caller does not say.
pub const LOOKS: u64 = 100;

/// A pair on a stretch of the path. floor: least distance at rows, m. At either end: how far it is parted, m, and along which
/// direction in its base.
#[derive(Clone, Copy)]
struct Doubt {
    pair: usize,
    floor: f64,
    speed: f64,
    first: (f64, Vec3),
    last: (f64, Vec3),
}

/// Nothing is allocated once it has seen a path of the length at hand.
pub struct PathChecker {
    pub stage: Stage,
    /// Of its margin, what a pair shall keep.
    share: f64,
    arms: Arms,
    /// Direction that last opened each pair.
    directions: Vec<Vec3>,
    /// The farthest that a pair which is too near has been since it is; -infinity: it is not.
    held: Vec<f64>,
    excused: Vec<bool>,
    doubts: Vec<Doubt>,
    way: Way,
    instead: Way,
    stretch: Stretch,
    /// How far slides are drawn out at most, m.
    drawn: f64,
    looks_before: u64,
    /// Postures of one path that are looked at.
    pub most_looks: u64,
    /// The pair for which a path was refused last.
    pub refused: Option<usize>,
}

impl PathChecker {
    /// movers: velocity coordinates, and columns of a posture, of the joints that a path moves.
    pub fn new(
        body: Arc<Body>,
        set: Arc<ObserverSet>,
        movers: &[usize],
        columns: Vec<usize>,
        soles: Vec<(usize, Vec3)>,
    ) -> Self {
        Self {
            share: 0.0,
            arms: Arms::new(&body, &set, movers, &soles),
            held: vec![f64::NEG_INFINITY; set.pairs.len()],
            excused: vec![false; set.pairs.len()],
            doubts: Vec::with_capacity(32 * set.pairs.len()),
            way: Way::default(),
            instead: Way::default(),
            stretch: Stretch::default(),
            drawn: 0.0,
            directions: vec![[0.0; 3]; set.pairs.len()],
            looks_before: 0,
            most_looks: LOOKS,
            refused: None,
            stage: Stage::new(body, set, columns, soles),
        }
    }

    /// Forget which pairs were too near.
    pub fn restart(&mut self) {
        self.held.fill(f64::NEG_INFINITY);
        self.refused = None;
    }

    /// Whether every pair keeps apart on a path (rows, movers) that begins now, `dt` s from row to row, the robot standing as in
    /// posture `q`. A pair that is too near at the first row may only move apart.
    ///
    /// instead: what the robot does if this path is refused. Where an obstacle comes at the robot, a path on which it is at no row
    /// nearer than it came by then on that one is clear of it: a refusal must not keep the robot from getting out of the way.
    ///
    /// share: of each pair's margin, what it shall keep. remember: the first row is where the robot was sent, so that what is let out
    /// is measured from there.
    pub fn is_clear(
        &mut self,
        q: &[f64],
        path: &[f64],
        instead: Option<&[f64]>,
        dt: f64,
        (share, remember): (f64, bool),
    ) -> bool {
        let n = self.stage.columns.len();
        self.way.load(path, n);
        self.instead.load(instead.unwrap_or(path), n);
        (self.stage.dt, self.share) = (dt, share);
        self.stage.stand(q);
        let moved = |(k, rest): &(usize, f64)| rest + self.way.largest(*k).max(self.instead.largest(*k));
        self.drawn = self.arms.drawn_still(q) + self.arms.slides.iter().map(moved).sum::<f64>();
        self.looks_before = self.stage.looks;
        let end = self.way.end as f64;
        if end == 0.0 {
            return true; // it stands
        }
        self.doubts.clear();
        self.excused.fill(false);
        self.collect(end, remember);
        self.doubts.is_empty() || {
            let may_flee = instead.is_some();
            self.look(end, remember, may_flee) && self.halved(0, self.doubts.len(), 0.0, end, may_flee)
        }
    }

    fn arms(&self, pair: usize) -> &[Arm] {
        self.arms.of(&self.stage.set, pair, self.stage.planted)
    }

    /// Pairs that neither their distance at the first row nor the direction that parted them last clears.
    fn collect(&mut self, end: f64, remember: bool) {
        self.stage.place(&self.way, 0.0);
        self.stretch.load(&self.way, 0.0, end, self.stage.dt);
        let longest = self.arms.longest.iter().enumerate();
        let most: f64 = longest.map(|(k, arm)| (arm + self.drawn) * self.way.gone(k, end)).sum();
        for pair in 0..self.held.len() {
            let floor = self.share * self.stage.set.pairs[pair].margin + BETWEEN;
            let gap = self.stage.gap(pair);
            let speed = self.stage.obstacle_speed(pair, most, self.stretch.time);
            let far = |motion: f64| gap - motion - speed * self.stretch.time > floor;
            if far(most) || far(self.stretch.motion(self.arms(pair), self.drawn)) {
                self.forget(pair, remember);
                continue;
            }
            let first = (self.stage.parted(pair, self.directions[pair]), self.directions[pair]);
            self.doubts.push(Doubt { pair, floor, speed, first, last: first });
        }
        if self.doubts.is_empty() {
            return;
        }
        self.stage.place(&self.way, end);
        let mut left = 0;
        for k in 0..self.doubts.len() {
            let doubt = self.doubts[k];
            let last = self.stage.parted(doubt.pair, doubt.first.1);
            if self.proven(&doubt, doubt.first.0, last, doubt.floor) {
                self.forget(doubt.pair, remember);
            } else {
                self.doubts[left] = doubt;
                left += 1;
            }
        }
        self.doubts.truncate(left);
    }

    /// Look at the pairs in doubt at both ends of the path. Returns false where one of them refuses it.
    fn look(&mut self, end: f64, remember: bool, may_flee: bool) -> bool {
        self.stage.place(&self.way, 0.0);
        for k in 0..self.doubts.len() {
            let mut doubt = self.doubts[k];
            doubt.first = self.stage.nearest(doubt.pair);
            doubt.floor = self.least(doubt.pair, doubt.first.0, doubt.floor, remember);
            self.directions[doubt.pair] = doubt.first.1;
            self.doubts[k] = doubt;
        }
        let mut left = 0;
        self.stage.place(&self.way, end);
        for k in 0..self.doubts.len() {
            let mut doubt = self.doubts[k];
            let across = self.stage.parted(doubt.pair, doubt.first.1);
            let whole = if end > 1.0 { doubt.floor } else { doubt.floor - BETWEEN };
            if across >= doubt.floor && self.proven(&doubt, doubt.first.0, across, whole) {
                continue;
            }
            doubt.last = self.stage.nearest(doubt.pair);
            if doubt.last.0 < doubt.floor {
                if !self.excuse(doubt.pair, may_flee) {
                    return false;
                }
                self.stage.place(&self.way, end);
                continue;
            }
            self.doubts[left] = doubt;
            left += 1;
        }
        self.doubts.truncate(left);
        true
    }

    /// Whether a pair keeps `floor` on the stretch at hand, at whose ends one and the same direction parts it so far.
    fn proven(&self, doubt: &Doubt, first: f64, last: f64, floor: f64) -> bool {
        // An obstacle goes by time and joints as they like: on several rows one may be there before the other has set off.
        let apart = if self.stretch.time > (1.0 + 1e-9) * self.stage.dt { 1.0 } else { 0.5 };
        let bend = self.stretch.bend(self.arms(doubt.pair), self.drawn) + apart * doubt.speed * self.stretch.time;
        first.min(last) - bend >= floor
    }

    /// A pair is far enough apart.
    fn forget(&mut self, pair: usize, remember: bool) {
        if remember {
            self.held[pair] = f64::NEG_INFINITY;
        }
    }

    /// What a pair that is `first` m apart at the first row must keep at rows: `floor`, or what is left of it.
    fn least(&mut self, pair: usize, first: f64, floor: f64, remember: bool) -> f64 {
        if first >= floor {
            self.forget(pair, remember);
            return floor;
        }
        if !remember {
            return first - LET_OUT;
        }
        // Something pushed it in: what is held is where it is now.
        let lost = first < self.held[pair] - LET_OUT;
        self.held[pair] = if lost { first } else { self.held[pair].max(first) };
        (self.held[pair] - LET_OUT).min(floor)
    }

    /// Whether doubts [start, stop) are clear between two times in rows, at both of which they are known.
    fn halved(&mut self, start: usize, stop: usize, from: f64, to: f64, may_flee: bool) -> bool {
        if start == stop {
            return true;
        }
        if self.stage.looks - self.looks_before > self.most_looks || to - from < LEAST_PART {
            return (start..stop).all(|k| self.excuse(self.doubts[k].pair, may_flee));
        }
        let middle = if to - from > 1.0 { (0.5 * (from + to)).floor() } else { 0.5 * (from + to) };
        self.stage.place(&self.way, middle);
        let base = self.doubts.len();
        for k in start..stop {
            let mut doubt = self.doubts[k];
            doubt.last = self.stage.nearest(doubt.pair);
            let least = if middle.fract() == 0.0 { doubt.floor } else { doubt.floor - BETWEEN };
            if doubt.last.0 < least {
                if !self.excuse(doubt.pair, may_flee) {
                    return false;
                }
                self.stage.place(&self.way, middle);
            }
            self.doubts.push(doubt); // up to the middle
        }
        for k in start..stop {
            let doubt = Doubt { first: self.doubts[base + k - start].last, ..self.doubts[k] };
            self.doubts.push(doubt); // from there on
        }
        let (split, end) = (base + stop - start, self.doubts.len());
        let first = self.open(base, split, from, middle, |s, d| (d.first.0, s.parted(d.pair, d.first.1)));
        let second = self.open(split, end, middle, to, |s, d| (s.parted(d.pair, d.last.1), d.last.0));
        let clear =
            self.halved(base, first, from, middle, may_flee) && self.halved(split, second, middle, to, may_flee);
        self.doubts.truncate(base);
        clear
    }

    /// Move those of doubts [start, stop) that are not proven on a stretch to the front; returns where they end. `parted`: how far
    /// at either end along the direction of the end that is not at hand, while everything stands where it does at the other.
    fn open(
        &mut self,
        start: usize,
        stop: usize,
        from: f64,
        to: f64,
        parted: impl Fn(&Stage, &Doubt) -> (f64, f64),
    ) -> usize {
        self.stretch.load(&self.way, from, to, self.stage.dt);
        let mut left = start;
        for k in start..stop {
            let doubt = self.doubts[k];
            let floor = if to - from > 1.0 { doubt.floor } else { doubt.floor - BETWEEN };
            let (first, last) = parted(&self.stage, &doubt);
            if !self.excused[doubt.pair] && !self.proven(&doubt, first, last, floor) {
                self.doubts[left] = doubt;
                left += 1;
            }
        }
        left
    }

    /// Whether an obstacle that comes at the robot is the only one to blame: at no row is it nearer than it came by then on the path
    /// that is followed instead.
    fn excuse(&mut self, pair: usize, may_flee: bool) -> bool {
        if self.excused[pair] {
            return true;
        }
        self.refused = Some(pair);
        if !may_flee || self.stage.moving(pair).is_none() {
            return false;
        }
        let rows = self.way.rows.max(self.instead.rows);
        let looks = self.stage.looks;
        let mut least = f64::INFINITY;
        self.excused[pair] = (1..rows).all(|row| {
            self.stage.place(&self.instead, row as f64);
            least = least.min(self.stage.nearest(pair).0);
            self.stage.place(&self.way, row as f64);
            self.stage.nearest(pair).0 >= least
        });
        self.looks_before += self.stage.looks - looks; // these do not count as looks of the path
        self.excused[pair]
    }
}
