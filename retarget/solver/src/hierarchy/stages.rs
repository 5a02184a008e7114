//! A cascade of least-distance problems: one stage for each level, then one for the metric.

use super::kernels::{add_rows, add_scaled, compile_twice, dot, dot_rows, has_avx2};
use super::problem::Problem;

/// A limit or a target is met within this, for a row of length one.
const MET: f64 = 1e-11;
/// Once x is this far from a limit that is held, it is computed anew before a small violation counts.
const DRIFT: f64 = 1e-12;
/// Rounding of a value that is computed from x, as a share of the length of x.
const LAST_DIGITS: f64 = 1e-14;
/// A row depends on others if at most this share of its length is independent of them.
const DEPENDENT: f64 = 1e-8;
/// Damping of a level of limits alone, in units of its rows. It is small, so that feasible limits are kept exactly.
const LEAST_OF_LIMITS: f64 = 1e-4;
/// Weight of missed targets against the metric, which has no unit in common with them. A posture may not bend a limb that is stretched
/// towards a target out of reach, as its linear model does not see the cost of that.
const YIELDING: f64 = 200.0;
/// Limits of one level that may be traded against each other at once.
const MOST_TRADED: usize = 32;
/// A limit that depends on active ones may be missed by this: they are nearly parallel, and rounding is enlarged.
const ROUNDING: f64 = 1e-6;
/// Most steps of a frame: 20 times the 99th percentile of OP3 among its 23 boxes.
pub const BUDGET: u32 = 2000;

/// Effort and end of a solve.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// Limits that entered or left the active set.
    pub steps: u32,
    /// The budget was spent, and the solution keeps the box and all limits that standing still keeps. Or rounding left a limit
    /// violated, or more than MOST_TRADED limits of a level conflict, and the solution keeps the box and the values of the stages
    /// before.
    pub capped: bool,
}

/// A limit of a variable (index below n) or of a row (n + row), at its upper side or not.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Limit {
    index: usize,
    upper: bool,
}

/// Work space of the solver; nothing is allocated after the first solve of a given size.
///
/// Vectors of a stage have the problem's variables first, padded, then slack variables of its rows.
#[derive(Default)]
pub struct Stages {
    budget: u32,
    /// Length of the vectors of the stage.
    width: usize,
    /// Most vectors of a stage, and the stride of the triangle's columns.
    most: usize,
    /// Orthonormal rows that span the values fixed by earlier stages, of the problem's row length, one after the other.
    fixed: Vec<f64>,
    /// Orthonormal vectors of this stage beside those: `soft` of them span its targets, then there is one for each held limit, the
    /// part of its normal that is independent of all before.
    own: Vec<f64>,
    soft: usize,
    /// The active set, with the Lagrange multipliers `forces`.
    held: Vec<Limit>,
    /// Column j has the normal of held limit j in the basis of held limits.
    triangle: Vec<f64>,
    forces: Vec<f64>,
    /// Held limits of the stage before, which are tried first.
    likely: Vec<Limit>,
    ignored: Vec<Limit>,
    /// Bounds of rows after earlier stages: the values that targets reached, and limits no tighter than they are kept.
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// The point where the stage is, and where it was before any limit was held.
    x: Vec<f64>,
    unlimited: Vec<f64>,
    /// A limit is met within this: MET, or more where x is so long that rounding is.
    met: f64,
    /// A point that keeps the values of all earlier stages.
    kept: Vec<f64>,
    damping: f64,
    /// Largest remaining error of any level.
    unmet: f64,
    /// Longest step of the stage.
    reach: f64,
    /// Rows whose limits earlier stages keep, and rows whose limits have a slack in this stage, with its place.
    hard: Vec<usize>,
    traded: Vec<usize>,
    slack: Vec<usize>,
    free_slacks: Vec<usize>,
    norms: Vec<f64>,
    /// Length of the path of x so far, and the value of `moved` before which x cannot be beyond the limits of each row.
    moved: f64,
    due: Vec<f64>,
    work: Vec<f64>,
    coefficients: Vec<f64>,
    again: Vec<f64>,
    back: Vec<f64>,
}

/// A row that has no slack variable now.
const NONE: usize = usize::MAX;

compile_twice! {
    fn solve(stages: &mut Stages, p: &mut Problem, budget: u32) -> Outcome {
        stages.run(p, budget)
    }
}

impl Stages {
    /// Solve `problem` into `problem.z`, in at most `budget` steps.
    pub fn solve(&mut self, problem: &mut Problem, budget: u32) -> Outcome {
        solve(has_avx2(), self, problem, budget)
    }

    #[inline(always)]
    fn run(&mut self, p: &mut Problem, budget: u32) -> Outcome {
        self.prepare(p, budget);
        for i in 0..p.n {
            self.kept[i] = p.still[i].max(p.lo[i]).min(p.hi[i]);
        }
        let stages = p.level_count() - usize::from(p.soft_last);
        let mut found = true;
        for k in 0..stages {
            found &= self.stage(p, k);
            self.fix_level(p, k);
        }
        found &= self.last_stage(p, stages);
        if !found && self.budget == 0 {
            self.keep_limits(p);
        }
        for i in 0..p.n {
            p.z[i] = self.x[i].max(p.lo[i]).min(p.hi[i]);
        }
        Outcome { steps: budget - self.budget, capped: !found }
    }

    #[inline(always)]
    fn prepare(&mut self, p: &mut Problem, budget: u32) {
        let largest = (0..p.level_count()).map(|k| p.level(k).len()).max().unwrap_or(0);
        let (m, widest) = (p.row_count(), padded(p.stride + largest));
        (self.budget, self.moved, self.unmet) = (budget, 0.0, 0.0);
        self.lower.clone_from(&p.lower);
        self.upper.clone_from(&p.upper);
        self.most = p.n + largest + 1;
        self.fixed.clear();
        self.fixed.reserve(p.n * p.stride);
        self.own.resize(self.most * widest, 0.0);
        self.triangle.resize(self.most * self.most, 0.0);
        for vector in [&mut self.x, &mut self.unlimited, &mut self.work] {
            vector.clear();
            vector.resize(widest, 0.0);
        }
        self.kept.clear();
        self.kept.resize(p.stride, 0.0);
        self.coefficients.resize(p.n + self.most, 0.0);
        self.norms.clear();
        self.norms.extend((0..m).map(|r| if p.present[r] { dot(p.row(r), p.row(r)).sqrt().max(1e-12) } else { 1.0 }));
        self.slack.clear();
        self.slack.resize(m, NONE);
        self.due.clear();
        self.due.resize(m, f64::NEG_INFINITY);
        for limits in [&mut self.held, &mut self.likely, &mut self.ignored] {
            limits.clear();
            limits.reserve(p.n + m);
        }
        for numbers in [&mut self.forces, &mut self.back, &mut self.again] {
            numbers.clear();
            numbers.reserve(self.most.max(p.stride));
        }
        for rows in [&mut self.hard, &mut self.traded] {
            rows.clear();
            rows.reserve(m);
        }
        self.free_slacks.clear();
        self.free_slacks.reserve(widest);
        p.held.clear();
        p.held.resize(m, false);
    }

    /// The step of level k: the point that is nearest to standing still, with slacks as distances. False if it was not found.
    #[inline(always)]
    fn stage(&mut self, p: &mut Problem, k: usize) -> bool {
        let (mut requested, mut missing, mut targets) = (0.0, 0.0, 0);
        self.traded.clear();
        for r in p.level(k).filter(|r| p.present[*r]) {
            let at = dot(p.row(r), &self.kept);
            if p.is_equality(r) {
                let (now, then) = (self.lower[r] - dot(p.row(r), &p.still), self.lower[r] - at);
                (requested, missing, targets) = (requested + now * now, missing + then * then, targets + 1);
            } else {
                self.traded.push(r);
                let beyond = (self.lower[r] - at).max(at - self.upper[r]);
                if beyond > MET * self.norms[r] {
                    missing += beyond * beyond;
                }
            }
        }
        if missing <= MET * MET {
            self.traded.clear();
            return true;
        }
        let error = requested.max(missing).max(p.error2[k]).sqrt();
        // A damped step is no longer than this. Limits alone are kept exactly, but go no farther for it either.
        let longest = 0.5 * (error / p.damping).sqrt();
        (self.damping, self.reach) = match targets {
            0 => (LEAST_OF_LIMITS, longest),
            _ => ((p.damping * error + p.least_damping * p.least_damping).sqrt(), f64::INFINITY),
        };
        let found = self.approach(p, k, targets, |_, p, i| p.still[i])
            && (1..p.rounds).all(|_| self.approach(p, k, targets, |stages, _, i| stages.kept[i]));
        for r in self.traded.drain(..) {
            self.slack[r] = NONE;
        }
        if targets > 0 {
            let left = p.level(k).filter(|r| p.present[*r] && p.is_equality(*r)).fold(0.0, |sum, r| {
                let off = self.lower[r] - dot(p.row(r), &self.kept);
                sum + off * off
            });
            let beyond = (p.error2[k].sqrt() - requested.sqrt()).max(0.0);
            self.unmet = self.unmet.max(left.sqrt() + beyond);
        }
        found
    }

    /// One round of a stage: from standing still, or from what the round before found.
    #[inline(always)]
    fn approach(
        &mut self,
        p: &mut Problem,
        k: usize,
        targets: usize,
        from: impl Fn(&Self, &Problem, usize) -> f64,
    ) -> bool {
        let traded = self.traded.len().min(MOST_TRADED);
        self.begin(p, targets + traded, from);
        let mut slot = p.stride;
        for r in p.level(k) {
            if p.present[r] && p.is_equality(r) {
                self.add_target(p, r, Some(slot));
                slot += 1;
            }
        }
        self.free_slacks.clear();
        self.free_slacks.extend((slot..slot + traded).rev());
        for &r in &self.traded {
            self.slack[r] = NONE;
        }
        let found = self.settle(p);
        let length2: f64 = (0..p.n).fold(0.0, |sum, i| sum + (self.x[i] - self.kept[i]) * (self.x[i] - self.kept[i]));
        let share = (self.reach / length2.sqrt()).min(1.0);
        for i in 0..p.n {
            let there = self.x[i].max(p.lo[i]).min(p.hi[i]);
            self.kept[i] = if share < 1.0 { self.kept[i] + share * (there - self.kept[i]) } else { there };
        }
        found
    }

    /// Fix the values that level k has reached.
    #[inline(always)]
    fn fix_level(&mut self, p: &mut Problem, k: usize) {
        for r in p.level(k).filter(|r| p.present[*r]) {
            let at = dot(p.row(r), &self.kept);
            if p.is_equality(r) {
                (self.lower[r], self.upper[r]) = (at, at);
                self.work.resize(p.stride, 0.0);
                self.work.copy_from_slice(p.row(r));
                self.project(p, 0, None);
                let length = dot(&self.work, &self.work).sqrt();
                if length > DEPENDENT * self.norms[r] && self.fixed.len() < p.n * p.stride {
                    self.fixed.extend(self.work.iter().map(|w| w / length));
                }
            } else {
                (self.lower[r], self.upper[r]) = (self.lower[r].min(at), self.upper[r].max(at));
                self.hard.push(r);
            }
        }
    }

    /// The least z that keeps the values of all levels, with the soft tasks of the last level.
    #[inline(always)]
    fn last_stage(&mut self, p: &mut Problem, k: usize) -> bool {
        let damping = YIELDING * p.damping * self.unmet;
        let share = damping / (1.0 + damping);
        self.begin(p, 0, |_, p, i| share * p.still[i]);
        if p.soft_last {
            for r in p.level(k).filter(|r| p.present[*r]) {
                if p.is_equality(r) {
                    self.add_target(p, r, None);
                } else {
                    self.hard.push(r);
                }
            }
        }
        self.settle(p)
    }

    /// Begin a stage with `slacks` at the point nearest to the desired one that keeps the fixed values, without regard to limits.
    #[inline(always)]
    fn begin(&mut self, p: &Problem, slacks: usize, desired: impl Fn(&Self, &Problem, usize) -> f64) {
        self.width = padded(p.stride + slacks);
        self.again.clear();
        self.again.extend_from_slice(&self.x[..p.stride]);
        for vector in [&mut self.x, &mut self.work] {
            vector.clear();
            vector.resize(self.width, 0.0);
        }
        for i in 0..p.n {
            self.x[i] = desired(self, p, i);
            self.work[i] = self.kept[i] - self.x[i];
        }
        let coefficients = &mut self.coefficients[..self.fixed.len() / p.stride];
        dot_rows(&self.work[..p.stride], &self.fixed, coefficients);
        add_rows(&mut self.x[..p.stride], 1.0, coefficients, &self.fixed);
        add_scaled(&mut self.again, -1.0, &self.x[..p.stride]);
        self.moved += dot(&self.again, &self.again).sqrt();
        self.soft = 0;
    }

    /// Add the target of a row, with the slack at `slot` if there is one. x goes to the nearest point that meets it.
    #[inline(always)]
    fn add_target(&mut self, p: &Problem, r: usize, slot: Option<usize>) {
        self.work[..p.stride].copy_from_slice(p.row(r));
        self.work[p.stride..].fill(0.0);
        let mut missing = self.lower[r] - dot(p.row(r), &self.x[..p.stride]);
        if let Some(slot) = slot {
            self.work[slot] = self.damping;
            missing -= self.damping * self.x[slot];
        }
        self.project(p, self.soft, None);
        let length = dot(&self.work, &self.work).sqrt();
        if length <= DEPENDENT * self.norms[r] {
            return;
        }
        add_scaled(&mut self.x, missing / (length * length), &self.work);
        self.moved += missing.abs() / length;
        self.keep_direction(self.soft, 1.0 / length);
        self.soft += 1;
    }

    /// Store `work` times `scale` as vector j of this stage.
    #[inline(always)]
    fn keep_direction(&mut self, j: usize, scale: f64) {
        for (to, w) in self.own[j * self.width..(j + 1) * self.width].iter_mut().zip(&self.work) {
            *to = w * scale;
        }
    }

    /// Remove from `work` its part along `fixed` and along the first `count` vectors of this stage, twice if digits are lost.
    /// `coefficients` become the share of each. unit: `work` has this number at this place, and else zeros.
    #[inline(always)]
    fn project(&mut self, p: &Problem, count: usize, unit: Option<(usize, f64)>) {
        let (work, fixed, own) = (&mut self.work, &self.fixed, &self.own[..count * self.width]);
        let (first, rest) = self.coefficients.split_at_mut(fixed.len() / p.stride);
        let rest = &mut rest[..count];
        let whole = dot(work, work);
        if let Some((place, sign)) = unit {
            let rows = fixed.chunks_exact(p.stride).chain(own.chunks_exact(self.width));
            for (c, row) in first.iter_mut().chain(rest.iter_mut()).zip(rows) {
                *c = sign * row[place];
            }
            add_rows(&mut work[..p.stride], -1.0, first, fixed);
        } else {
            dot_rows(&work[..p.stride], fixed, first);
            add_rows(&mut work[..p.stride], -1.0, first, fixed);
            dot_rows(work, own, rest);
        }
        add_rows(work, -1.0, rest, own);
        if dot(work, work) < 0.1 * whole {
            dot_rows(&work[..p.stride], fixed, first);
            add_rows(&mut work[..p.stride], -1.0, first, fixed);
            self.again.resize(count, 0.0);
            dot_rows(work, own, &mut self.again);
            add_rows(work, -1.0, &self.again, own);
            for (c, more) in rest.iter_mut().zip(&self.again) {
                *c += more;
            }
        }
    }

    /// Move x, which meets all targets, to the point nearest to the start of the stage that keeps all limits, by the dual active set of
    /// Goldfarb and Idnani. False if it was not found: x is then as near to it, on the line from `kept`, as limits allow.
    #[inline(always)]
    fn settle(&mut self, p: &mut Problem) -> bool {
        std::mem::swap(&mut self.held, &mut self.likely);
        self.held.clear();
        self.forces.clear();
        self.ignored.clear();
        self.unlimited.clone_from(&self.x);
        self.met = self.tolerance();
        let (mut next, mut exact) = (0, true);
        let found = loop {
            let mut chosen = None;
            while next < self.likely.len() && chosen.is_none() {
                let limit = self.likely[next];
                next += 1;
                let acts = limit.index < p.n || self.slack[limit.index - p.n] == NONE;
                if acts && self.violation(p, limit) > self.met && self.is_here(p, limit) {
                    chosen = Some(limit);
                }
            }
            let Some(limit) = chosen.or_else(|| self.worst(p)) else { break true };
            let is_held = self.held.contains(&limit);
            let by_drift = is_held || self.violation(p, limit) < ROUNDING && self.drift(p) > DRIFT;
            if by_drift && !exact {
                self.remove_drift(p);
                exact = true;
            } else if is_held {
                self.ignored.push(limit);
            } else if self.hold(p, limit) {
                exact = false;
            } else {
                break false;
            }
        };
        for limit in self.held.iter().filter(|limit| limit.index >= p.n) {
            p.held[limit.index - p.n] = true;
        }
        if !found {
            self.take_feasible(p);
        }
        found
    }

    /// Compute x and the forces of the held limits anew. Each step adds its rounding to both, until limits that are met seem violated.
    #[inline(always)]
    fn remove_drift(&mut self, p: &Problem) {
        self.again.clear();
        self.again.extend_from_slice(&self.x[..p.stride]);
        self.x.clone_from(&self.unlimited);
        self.back.clear();
        for j in 0..self.held.len() {
            let column = &self.triangle[j * self.most..j * self.most + j + 1];
            let met = self.back.iter().zip(column).fold(0.0, |sum, (back, entry)| sum + back * entry);
            self.back.push((self.violation(p, self.held[j]) - met) / column[j]);
        }
        let first = self.soft * self.width;
        add_rows(&mut self.x, 1.0, &self.back, &self.own[first..first + self.held.len() * self.width]);
        self.met = self.tolerance();
        add_scaled(&mut self.again, -1.0, &self.x[..p.stride]);
        self.moved += dot(&self.again, &self.again).sqrt();
        self.divide_by_triangle();
        for (force, back) in self.forces.iter_mut().zip(&self.back) {
            *force = back.max(0.0); // it was positive but for rounding
        }
    }

    /// Distance of x from the held limit that it is farthest from.
    #[inline(always)]
    fn drift(&self, p: &Problem) -> f64 {
        self.held.iter().fold(0.0, |most: f64, limit| most.max(self.violation(p, *limit).abs()))
    }

    /// The violation below which limits are met.
    #[inline(always)]
    fn tolerance(&self) -> f64 {
        MET.max(LAST_DIGITS * dot(&self.x, &self.x).sqrt())
    }

    /// `back`, which is in the basis of held limits, becomes the share of each held limit.
    #[inline(always)]
    fn divide_by_triangle(&mut self) {
        for j in (0..self.back.len()).rev() {
            let column = &self.triangle[j * self.most..j * self.most + j + 1];
            let value = self.back[j] / column[j];
            self.back[j] = value;
            for (back, entry) in self.back[..j].iter_mut().zip(column) {
                *back -= entry * value;
            }
        }
    }

    /// True if the limit is one of this stage.
    #[inline(always)]
    fn is_here(&self, p: &Problem, limit: Limit) -> bool {
        limit.index < p.n || self.hard.contains(&(limit.index - p.n)) || self.traded.contains(&(limit.index - p.n))
    }

    /// Distance of x beyond a limit.
    #[inline(always)]
    fn violation(&self, p: &Problem, limit: Limit) -> f64 {
        let i = limit.index;
        let (at, length, lower, upper) = if i < p.n {
            (self.x[i], 1.0, p.lo[i], p.hi[i])
        } else {
            let (at, length) = self.value(p, i - p.n);
            (at, length, self.lower[i - p.n], self.upper[i - p.n])
        };
        (if limit.upper { at - upper } else { lower - at }) / length
    }

    /// Value of a row at x, slack included, and the length of its normal.
    #[inline(always)]
    fn value(&self, p: &Problem, r: usize) -> (f64, f64) {
        let (at, norm) = (dot(p.row(r), &self.x[..p.stride]), self.norms[r]);
        match self.slack[r] {
            NONE => (at, norm),
            slot => (at + self.damping * self.x[slot], (norm * norm + self.damping * self.damping).sqrt()),
        }
    }

    /// The limit that x is farthest beyond.
    #[inline(always)]
    fn worst(&mut self, p: &Problem) -> Option<Limit> {
        let (mut most, mut found) = (self.met, None);
        let ignored = &self.ignored;
        let mut consider = |index: usize, below: f64, above: f64| {
            let limit = Limit { index, upper: above > below };
            if below.max(above) > most && !ignored.contains(&limit) {
                (most, found) = (below.max(above), Some(limit));
            }
        };
        for i in 0..p.n {
            consider(i, p.lo[i] - self.x[i], self.x[i] - p.hi[i]);
        }
        for &r in self.hard.iter().chain(&self.traded) {
            if self.moved < self.due[r] {
                continue;
            }
            let (at, length) = self.value(p, r);
            let (below, above) = ((self.lower[r] - at) / length, (at - self.upper[r]) / length);
            self.due[r] = if self.slack[r] == NONE { self.moved - below.max(above) } else { f64::NEG_INFINITY };
            consider(p.n + r, below, above);
        }
        found
    }

    /// Write the unit normal of a limit, inward, into `work`.
    #[inline(always)]
    fn normal(&mut self, p: &Problem, limit: Limit) {
        let sign = if limit.upper { -1.0 } else { 1.0 };
        self.work.fill(0.0);
        if limit.index < p.n {
            self.work[limit.index] = sign;
            return;
        }
        let r = limit.index - p.n;
        let (_, length) = self.value(p, r);
        for (w, c) in self.work[..p.stride].iter_mut().zip(p.row(r)) {
            *w = sign * c / length;
        }
        if self.slack[r] != NONE {
            self.work[self.slack[r]] = sign * self.damping / length;
        }
    }

    /// Move x to the point at which a violated limit is active, with the active set that belongs to it. False if none was found.
    #[inline(always)]
    fn hold(&mut self, p: &Problem, limit: Limit) -> bool {
        if limit.index >= p.n && self.slack[limit.index - p.n] == NONE && self.traded.contains(&(limit.index - p.n)) {
            let Some(slot) = self.free_slacks.pop() else { return false };
            self.slack[limit.index - p.n] = slot;
        }
        let unit = (limit.index < p.n).then_some((limit.index, if limit.upper { -1.0 } else { 1.0 }));
        let mut force = 0.0;
        loop {
            if self.budget == 0 {
                return false;
            }
            self.budget -= 1;
            self.normal(p, limit);
            let (count, vectors) = (self.held.len(), self.soft + self.held.len());
            self.project(p, vectors, unit);
            let first = self.fixed.len() / p.stride + self.soft;
            let left2 = dot(&self.work, &self.work);
            self.back.clear();
            self.back.extend_from_slice(&self.coefficients[first..first + count]);
            self.divide_by_triangle();
            // Step lengths at which the multiplier of a held limit gets negative, and at which this limit is met.
            let (mut most, mut dropped) = (f64::INFINITY, 0);
            for j in 0..count {
                if self.back[j] > 1e-12 && self.forces[j] < most * self.back[j] {
                    (most, dropped) = (self.forces[j] / self.back[j], j);
                }
            }
            let violation = self.violation(p, limit);
            // A slack of its own is in none of the vectors yet, so that a limit with one is independent of them.
            let has_slack = limit.index >= p.n && self.slack[limit.index - p.n] != NONE;
            let least = if has_slack { 0.0 } else { 1e-14 };
            let whole = if left2 > least && vectors < self.most { violation / left2 } else { f64::INFINITY };
            let step = most.min(whole);
            if !step.is_finite() {
                self.ignored.push(limit);
                return violation < ROUNDING;
            }
            if whole.is_finite() {
                add_scaled(&mut self.x, step, &self.work);
                self.moved += step * left2.sqrt();
            }
            for (own, back) in self.forces.iter_mut().zip(&self.back) {
                *own = (*own - step * back).max(0.0);
            }
            force += step;
            if whole <= most {
                let (length, column) = (left2.sqrt(), count * self.most);
                self.keep_direction(vectors, 1.0 / length);
                self.triangle[column..column + count].copy_from_slice(&self.coefficients[first..first + count]);
                self.triangle[column + count] = length;
                self.held.push(limit);
                self.forces.push(force);
                return true;
            }
            self.drop(p, dropped);
        }
    }

    /// Remove held limit l from the active set. Givens rotations restore the triangle.
    #[inline(always)]
    fn drop(&mut self, p: &Problem, l: usize) {
        let (count, most, width) = (self.held.len(), self.most, self.width);
        let limit = self.held.remove(l);
        self.forces.remove(l);
        for j in l + 1..count {
            self.triangle.copy_within(j * most..j * most + j + 1, (j - 1) * most);
        }
        for j in l..count - 1 {
            let (f, g) = (self.triangle[j * most + j], self.triangle[j * most + j + 1]);
            let length = (f * f + g * g).sqrt();
            let (c, s) = (f / length, g / length);
            for k in j..count - 1 {
                let (x, y) = (self.triangle[k * most + j], self.triangle[k * most + j + 1]);
                self.triangle[k * most + j] = c * x + s * y;
                self.triangle[k * most + j + 1] = c * y - s * x;
            }
            let first = self.soft + j;
            let (left, right) = self.own.split_at_mut((first + 1) * width);
            for (x, y) in left[first * width..].iter_mut().zip(&mut right[..width]) {
                (*x, *y) = (c * *x + s * *y, c * *y - s * *x);
            }
        }
        if limit.index >= p.n && self.slack[limit.index - p.n] != NONE {
            let slot = std::mem::replace(&mut self.slack[limit.index - p.n], NONE);
            self.x[slot] = 0.0;
            for j in 0..count - 1 {
                self.own[(self.soft + j) * width + slot] = 0.0;
            }
            self.free_slacks.push(slot);
        }
    }

    /// Move from standing still towards x as far as all limits allow, those of levels without a stage so far included.
    #[inline(always)]
    fn keep_limits(&mut self, p: &Problem) {
        for i in 0..p.n {
            self.kept[i] = p.still[i].max(p.lo[i]).min(p.hi[i]);
        }
        self.hard.clear();
        self.hard.extend((0..p.row_count()).filter(|r| p.present[*r] && !p.is_equality(*r)));
        self.lower.clone_from(&p.lower);
        self.upper.clone_from(&p.upper);
        self.take_feasible(p);
    }

    /// Move from `kept` towards x as far as limits allow.
    #[inline(always)]
    fn take_feasible(&mut self, p: &Problem) {
        let mut share: f64 = 1.0;
        let mut meet = |from: f64, to: f64, lower: f64, upper: f64| {
            if to > upper && to > from {
                share = share.min(((upper - from) / (to - from)).max(0.0));
            } else if to < lower && to < from {
                share = share.min(((from - lower) / (from - to)).max(0.0));
            }
        };
        for i in 0..p.n {
            meet(self.kept[i], self.x[i], p.lo[i], p.hi[i]);
        }
        for &r in &self.hard {
            let (from, to) = (dot(p.row(r), &self.kept), dot(p.row(r), &self.x[..p.stride]));
            meet(from, to, self.lower[r], self.upper[r]);
        }
        for i in 0..p.n {
            self.x[i] = self.kept[i] + share * (self.x[i] - self.kept[i]);
        }
        self.moved = f64::INFINITY; // `due` of rows no longer holds
    }
}

fn padded(count: usize) -> usize {
    count.div_ceil(8) * 8
}
