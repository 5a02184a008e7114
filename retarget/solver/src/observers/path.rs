//! Distances of pairs along a path of postures, between its rows too.
//!
//! Two convex solids are at least as far apart as along any one direction. For a direction that is fixed in the frame that both sides
//! hang on, that separation is, for every pair of their points, a smooth function of the joints: between the ends of a stretch it is
//! below both of its ends by no more than the stretch bends (`Stretch::bend`). A stretch that this does not prove is halved.

use super::law::{BETWEEN, LET_OUT};
use super::scene::PathScene;
use super::set::ObserverSet;
use super::timed_path::{Arm, Arms, Stretch, TimedPath};
use crate::body::Body;
use crate::math::Vec3;
use std::sync::Arc;

/// Stretches shorter than this share of a row are not halved. A path that is not proven by then is not clear.
const LEAST_PART: f64 = 1.0 / 256.0;
/// Default of the most postures of one path that are computed, for the same reason.
pub const LOOKS: u64 = 100;

/// A pair that is not yet proven on a stretch of the path.
#[derive(Clone, Copy)]
struct Doubt {
    pair: usize,
    /// Least distance at rows, m.
    floor: f64,
    /// Most speed of its obstacle, m/s.
    speed: f64,
    /// Separation at either end, m, and its direction in the pair's base.
    first: (f64, Vec3),
    last: (f64, Vec3),
}

/// Check of paths. Nothing is allocated after the first path of a length.
pub struct PathChecker {
    pub scene: PathScene,
    /// Share of its margin that a pair keeps.
    share: f64,
    arms: Arms,
    /// Direction that last separated each pair.
    directions: Vec<Vec3>,
    /// Largest distance of a pair since it is too near, m; -infinity if it is not.
    held: Vec<f64>,
    /// Pairs that do not count on this path, see `is_exempt`.
    exempt: Vec<bool>,
    doubts: Vec<Doubt>,
    path: TimedPath,
    fallback: TimedPath,
    stretch: Stretch,
    /// Most extension of all slides, m.
    drawn: f64,
    looks_before: u64,
    /// Most postures of one path that are computed.
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
            exempt: vec![false; set.pairs.len()],
            doubts: Vec::with_capacity(32 * set.pairs.len()),
            path: TimedPath::default(),
            fallback: TimedPath::default(),
            stretch: Stretch::default(),
            drawn: 0.0,
            directions: vec![[0.0; 3]; set.pairs.len()],
            looks_before: 0,
            most_looks: LOOKS,
            refused: None,
            scene: PathScene::new(body, set, columns, soles),
        }
    }

    /// Forget which pairs were too near.
    pub fn restart(&mut self) {
        self.held.fill(f64::NEG_INFINITY);
        self.refused = None;
    }

    /// True if every pair keeps its distance on a path (rows, movers) that begins now, `dt` s from row to row, of a robot that stands as
    /// in posture `q`. A pair that is too near at the first row may only separate.
    ///
    /// instead: the path that the robot follows if this one is refused. A moving obstacle that is at no row nearer than it came so far on
    /// that path does not count: a refusal must not keep the robot from moving away from it. share: of each pair's margin, to be kept.
    /// remember: the first row is the commanded posture, so that `LET_OUT` is measured from there.
    pub fn is_clear(
        &mut self,
        q: &[f64],
        path: &[f64],
        instead: Option<&[f64]>,
        dt: f64,
        (share, remember): (f64, bool),
    ) -> bool {
        let n = self.scene.columns.len();
        self.path.load(path, n);
        self.fallback.load(instead.unwrap_or(path), n);
        (self.scene.dt, self.share) = (dt, share);
        self.scene.stand(q);
        let moved = |(k, rest): &(usize, f64)| rest + self.path.largest(*k).max(self.fallback.largest(*k));
        let still = |(address, rest): &(usize, f64)| q[*address].abs() + rest;
        self.drawn = self.arms.still.iter().map(still).sum::<f64>() + self.arms.slides.iter().map(moved).sum::<f64>();
        self.looks_before = self.scene.looks;
        let end = self.path.end as f64;
        if end == 0.0 {
            return true; // no motion
        }
        self.doubts.clear();
        self.exempt.fill(false);
        self.collect(end, remember);
        self.doubts.is_empty() || {
            let has_fallback = instead.is_some();
            self.look(end, remember, has_fallback) && self.halved(0, self.doubts.len(), 0.0, end, has_fallback)
        }
    }

    fn arms(&self, pair: usize) -> &[Arm] {
        self.arms.of(&self.scene.set, pair, self.scene.planted)
    }

    /// Collect the pairs that neither their distance at the first row nor the direction that last separated them proves clear.
    fn collect(&mut self, end: f64, remember: bool) {
        self.scene.place(&self.path, 0.0);
        self.stretch.load(&self.path, 0.0, end, self.scene.dt);
        let longest = self.arms.longest.iter().enumerate();
        let most: f64 = longest.map(|(k, arm)| (arm + self.drawn) * self.path.gone(k, end)).sum();
        for pair in 0..self.held.len() {
            let floor = self.share * self.scene.set.pairs[pair].margin + BETWEEN;
            let gap = self.scene.gap(pair);
            let speed = self.scene.obstacle_speed(pair, most, self.stretch.time);
            let far = |motion: f64| gap - motion - speed * self.stretch.time > floor;
            if far(most) || far(self.stretch.motion(self.arms(pair), self.drawn)) {
                self.forget(pair, remember);
                continue;
            }
            let first = (self.scene.separation(pair, self.directions[pair]), self.directions[pair]);
            self.doubts.push(Doubt { pair, floor, speed, first, last: first });
        }
        if self.doubts.is_empty() {
            return;
        }
        self.scene.place(&self.path, end);
        let mut left = 0;
        for k in 0..self.doubts.len() {
            let doubt = self.doubts[k];
            let last = self.scene.separation(doubt.pair, doubt.first.1);
            if self.is_proven(&doubt, doubt.first.0, last, doubt.floor) {
                self.forget(doubt.pair, remember);
            } else {
                self.doubts[left] = doubt;
                left += 1;
            }
        }
        self.doubts.truncate(left);
    }

    /// Measure the pairs in doubt at both ends of the path. Returns false if one of them is too near.
    fn look(&mut self, end: f64, remember: bool, has_fallback: bool) -> bool {
        self.scene.place(&self.path, 0.0);
        for k in 0..self.doubts.len() {
            let mut doubt = self.doubts[k];
            doubt.first = self.scene.nearest(doubt.pair);
            doubt.floor = self.least(doubt.pair, doubt.first.0, doubt.floor, remember);
            self.directions[doubt.pair] = doubt.first.1;
            self.doubts[k] = doubt;
        }
        let mut left = 0;
        self.scene.place(&self.path, end);
        for k in 0..self.doubts.len() {
            let mut doubt = self.doubts[k];
            let across = self.scene.separation(doubt.pair, doubt.first.1);
            let whole = if end > 1.0 { doubt.floor } else { doubt.floor - BETWEEN };
            if across >= doubt.floor && self.is_proven(&doubt, doubt.first.0, across, whole) {
                continue;
            }
            doubt.last = self.scene.nearest(doubt.pair);
            if doubt.last.0 < doubt.floor {
                if !self.is_exempt(doubt.pair, has_fallback) {
                    return false;
                }
                self.scene.place(&self.path, end);
                continue;
            }
            self.doubts[left] = doubt;
            left += 1;
        }
        self.doubts.truncate(left);
        true
    }

    /// True if a pair keeps `floor` on the present stretch. `first` and `last`: its separations at the ends along one direction.
    fn is_proven(&self, doubt: &Doubt, first: f64, last: f64, floor: f64) -> bool {
        // An obstacle moves with time, joints do not: over several rows one may arrive before the other has started.
        let offset = if self.stretch.time > (1.0 + 1e-9) * self.scene.dt { 1.0 } else { 0.5 };
        let bend = self.stretch.bend(self.arms(doubt.pair), self.drawn) + offset * doubt.speed * self.stretch.time;
        first.min(last) - bend >= floor
    }

    /// Forget that a pair was too near.
    fn forget(&mut self, pair: usize, remember: bool) {
        if remember {
            self.held[pair] = f64::NEG_INFINITY;
        }
    }

    /// Least distance at rows of a pair that is `first` m apart at the first row: `floor`, or less if it is already nearer.
    fn least(&mut self, pair: usize, first: f64, floor: f64, remember: bool) -> f64 {
        if first >= floor {
            self.forget(pair, remember);
            return floor;
        }
        if !remember {
            return first - LET_OUT;
        }
        // Something pushed it nearer: the distance of now is held.
        let lost = first < self.held[pair] - LET_OUT;
        self.held[pair] = if lost { first } else { self.held[pair].max(first) };
        (self.held[pair] - LET_OUT).min(floor)
    }

    /// True if doubts [start, stop) are clear between two times in rows, at both of which their separations are known.
    fn halved(&mut self, start: usize, stop: usize, from: f64, to: f64, has_fallback: bool) -> bool {
        if start == stop {
            return true;
        }
        if self.scene.looks - self.looks_before > self.most_looks || to - from < LEAST_PART {
            return (start..stop).all(|k| self.is_exempt(self.doubts[k].pair, has_fallback));
        }
        let middle = if to - from > 1.0 { (0.5 * (from + to)).floor() } else { 0.5 * (from + to) };
        self.scene.place(&self.path, middle);
        let base = self.doubts.len();
        for k in start..stop {
            let mut doubt = self.doubts[k];
            doubt.last = self.scene.nearest(doubt.pair);
            let least = if middle.fract() == 0.0 { doubt.floor } else { doubt.floor - BETWEEN };
            if doubt.last.0 < least {
                if !self.is_exempt(doubt.pair, has_fallback) {
                    return false;
                }
                self.scene.place(&self.path, middle);
            }
            self.doubts.push(doubt); // up to the middle
        }
        for k in start..stop {
            let doubt = Doubt { first: self.doubts[base + k - start].last, ..self.doubts[k] };
            self.doubts.push(doubt); // from there on
        }
        let (split, end) = (base + stop - start, self.doubts.len());
        let first = self.open(base, split, from, middle, |s, d| (d.first.0, s.separation(d.pair, d.first.1)));
        let second = self.open(split, end, middle, to, |s, d| (s.separation(d.pair, d.last.1), d.last.0));
        let clear = self.halved(base, first, from, middle, has_fallback)
            && self.halved(split, second, middle, to, has_fallback);
        self.doubts.truncate(base);
        clear
    }

    /// Move those of doubts [start, stop) that are not proven on a stretch to the front, and return their end. `separations` gives both ends
    /// of a stretch along one direction, with everything placed at one of them.
    fn open(
        &mut self,
        start: usize,
        stop: usize,
        from: f64,
        to: f64,
        separations: impl Fn(&PathScene, &Doubt) -> (f64, f64),
    ) -> usize {
        self.stretch.load(&self.path, from, to, self.scene.dt);
        let mut left = start;
        for k in start..stop {
            let doubt = self.doubts[k];
            let floor = if to - from > 1.0 { doubt.floor } else { doubt.floor - BETWEEN };
            let (first, last) = separations(&self.scene, &doubt);
            if !self.exempt[doubt.pair] && !self.is_proven(&doubt, first, last, floor) {
                self.doubts[left] = doubt;
                left += 1;
            }
        }
        left
    }

    /// True if a pair in violation is exempt: a moving obstacle is at no row nearer than it came so far on the fallback path. Otherwise it
    /// is the pair that refuses the path.
    fn is_exempt(&mut self, pair: usize, has_fallback: bool) -> bool {
        if self.exempt[pair] {
            return true;
        }
        self.refused = Some(pair);
        if !has_fallback || self.scene.moving(pair).is_none() {
            return false;
        }
        let rows = self.path.rows.max(self.fallback.rows);
        let looks = self.scene.looks;
        let mut least = f64::INFINITY;
        self.exempt[pair] = (1..rows).all(|row| {
            self.scene.place(&self.fallback, row as f64);
            least = least.min(self.scene.nearest(pair).0);
            self.scene.place(&self.path, row as f64);
            self.scene.nearest(pair).0 >= least
        });
        self.looks_before += self.scene.looks - looks; // these do not count as looks of the path
        self.exempt[pair]
    }
}
