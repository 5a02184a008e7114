//! The penetration of two overlapping cores: the direction of the largest (least negative) gap.
//!
//! The nearest surface of their difference is a flat facet (spanned by two edges, or a disc), a side that is curved once (an edge that
//! sweeps a disc: `ridge`) or twice (two discs: `curved`). Each kind gives candidates. The best one is exact, as every gap along a
//! direction is a lower bound.

use super::difference::{Best, Difference};
use crate::math::{add, add_scaled, cross, dot, norm, perpendicular, scale, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Sine below which two edges span no facet.
pub const PARALLEL: f64 = 1e-10;
/// Most steps of Newton's method on the sphere.
const STEPS: usize = 30;
/// Most halvings of one of its steps, while the gap does not grow.
const HALVINGS: usize = 12;
/// Newton's method has converged after a step this short, rad.
const CLOSE: f64 = 1e-6;
/// Directions that are tried between two discs.
const STARTS: usize = 64;
/// Number of the best of them, from which `climb` starts.
const FOLLOWED: usize = 4;

/// Uphill step in the tangent plane at n: Newton's, or along the slope where the gap is not concave.
fn step(m: &Difference, n: Vec3, gap: f64, basis: [Vec3; 2]) -> [f64; 2] {
    let lowest = m.lowest(n).w;
    let slope = [dot(lowest, basis[0]), dot(lowest, basis[1])];
    // Second derivative: each disc bends by radius / sine, across its axis; the sphere by the gap.
    let mut h = [gap, 0.0, gap];
    for disc in m.discs() {
        let across = cross(disc.axis, n);
        let sine = norm(across);
        let thin = sine.max(1e-12);
        let k = disc.radius / (thin * thin * thin);
        let (x, y) = (dot(across, basis[0]), dot(across, basis[1]));
        h = [h[0] + k * x * x, h[1] + k * x * y, h[2] + k * y * y];
    }
    if basis[1] == [0.0; 3] {
        let x = slope[0] / if h[0] > 0.0 { h[0] } else { h[0].abs() + 1e-300 };
        return [x / (1.0 + 2.0 * x.abs()), 0.0];
    }
    let determinant = h[0] * h[2] - h[1] * h[1];
    let (x, y) = if h[0] > 0.0 && determinant > 0.0 {
        ((h[2] * slope[0] - h[1] * slope[1]) / determinant, (h[0] * slope[1] - h[1] * slope[0]) / determinant)
    } else {
        let bend = h[0].abs() + h[2].abs() + 1e-300;
        (slope[0] / bend, slope[1] / bend)
    };
    let shrink = 1.0 / (1.0 + 2.0 * libm::hypot(x, y));
    [x * shrink, y * shrink]
}

fn moved(n: Vec3, basis: [Vec3; 2], x: f64, y: f64) -> Vec3 {
    let there = add_scaled(add_scaled(n, basis[0], x), basis[1], y);
    scale(there, 1.0 / norm(there))
}

/// The unit direction near n (with `edge`: and across it) from which no small step enlarges the gap.
pub fn climb(m: &Difference, mut n: Vec3, edge: Option<Vec3>) -> Vec3 {
    let mut gap = m.gap(n);
    for _ in 0..STEPS {
        let basis = match edge {
            Some(axis) => [cross(axis, n), [0.0; 3]],
            None => [perpendicular(n), cross(n, perpendicular(n))],
        };
        let [mut x, mut y] = step(m, n, gap, basis);
        if libm::hypot(x, y) < CLOSE {
            // Newton's last step gains less than rounding loses.
            return moved(n, basis, x, y);
        }
        let mut better = None;
        for _ in 0..HALVINGS {
            let tried = moved(n, basis, x, y);
            let value = m.gap(tried);
            if value > gap {
                better = Some((tried, value));
                break;
            }
            (x, y) = (0.5 * x, 0.5 * y);
        }
        let Some((tried, value)) = better else { break };
        (n, gap) = (tried, value);
    }
    n
}

/// Candidates on a side that two discs curve twice: climb from the best of directions spread over the sphere.
fn curved(m: &Difference, best: &mut Best) {
    if m.discs().len() < 2 {
        return;
    }
    let mut found = [(f64::NEG_INFINITY, best.normal); FOLLOWED];
    for k in 0..STARTS {
        // Fibonacci's spiral over the half of the sphere.
        let z = (k as f64 + 0.5) / STARTS as f64;
        let (s, c) = libm::sincos(2.399_963_229_728_653 * k as f64);
        let r = (1.0 - z * z).sqrt();
        let n = [r * c, r * s, z];
        let n = if dot(n, m.centre) < 0.0 { scale(n, -1.0) } else { n };
        let mut entry = (m.gap(n), n);
        for place in &mut found {
            if entry.0 > place.0 {
                std::mem::swap(&mut entry, place);
            }
        }
    }
    for (_, n) in found {
        best.consider(m, climb(m, n, None));
    }
    // Nearly parallel discs have little room between their normals, and no start there.
    let (first, second) = (m.discs()[0].axis, m.discs()[1].axis);
    let second = scale(second, 1f64.copysign(dot(first, second)));
    for share in [0.1, 0.3, 0.5, 0.7, 0.9] {
        let n = add(scale(first, 1.0 - share), scale(second, share));
        let n = scale(n, 1f64.copysign(dot(n, m.centre)) / norm(n));
        best.consider(m, climb(m, n, None));
    }
    best.consider(m, climb(m, best.normal, None));
}

/// Parts into which every smooth arc is cut to find the zeros of the slope.
const PARTS: usize = 4;
/// Inset from the ends of an arc, at which the slope jumps, as a share of the arc.
const INSET: f64 = 1e-9;
/// Most ends of arcs: two of the half circle, one for each other edge, two for each disc.
const MOST: usize = 2 + 5 + 4;

/// The half of the circle across an edge that looks towards A.
struct Circle<'a> {
    m: &'a Difference,
    ahead: Vec3,
    aside: Vec3,
}

impl Circle<'_> {
    fn direction(&self, angle: f64) -> Vec3 {
        let (s, c) = libm::sincos(angle);
        add_scaled(scale(self.ahead, c), self.aside, s)
    }

    /// Derivative of the gap.
    fn slope(&self, angle: f64) -> f64 {
        let (s, c) = libm::sincos(angle);
        let n = add_scaled(scale(self.ahead, c), self.aside, s);
        let along = add_scaled(scale(self.aside, c), self.ahead, -s);
        dot(self.m.lowest(n).w, along)
    }

    /// The angle between -pi/2 and pi/2 at which the direction is across `axis`.
    fn across(&self, axis: Vec3) -> f64 {
        let (x, y) = (dot(axis, self.ahead), dot(axis, self.aside));
        if y == 0.0 {
            FRAC_PI_2
        } else {
            libm::atan(-x / y)
        }
    }

    /// Angles, in order, between which the gap is smooth.
    fn arcs(&self, edge: usize) -> ([f64; MOST], usize) {
        let (mut ends, mut count) = ([-FRAC_PI_2; MOST], 2);
        ends[1] = FRAC_PI_2;
        for (k, other) in self.m.edges().iter().enumerate() {
            if k != edge {
                ends[count] = self.across(other.axis);
                count += 1;
            }
        }
        for disc in self.m.discs() {
            let across = self.across(disc.axis);
            ends[count] = across;
            ends[count + 1] = if across > 0.0 { across - FRAC_PI_2 } else { across + FRAC_PI_2 };
            count += 2;
        }
        ends[..count].sort_unstable_by(f64::total_cmp);
        (ends, count)
    }
}

/// Offer `best` every top of the gap over the directions across `edge`.
fn ridge(m: &Difference, edge: usize, best: &mut Best) {
    let axis = m.edges()[edge].axis;
    let flat = add_scaled(m.centre, axis, -dot(m.centre, axis));
    let length2 = dot(flat, flat);
    let ahead = if length2 > 1e-24 { scale(flat, 1.0 / length2.sqrt()) } else { perpendicular(axis) };
    let circle = Circle { m, ahead, aside: cross(axis, ahead) };
    let (ends, count) = circle.arcs(edge);
    for pair in ends[..count].windows(2) {
        let (start, width) = (pair[0], pair[1] - pair[0]);
        best.consider(m, circle.direction(start));
        if width < 1e-12 {
            continue;
        }
        let (mut low, mut rising) = (start + INSET * width, 0.0);
        for part in 0..=PARTS {
            let share = (part as f64 / PARTS as f64).clamp(INSET, 1.0 - INSET);
            let angle = start + share * width;
            let slope = circle.slope(angle);
            if rising > 0.0 && slope <= 0.0 {
                let top = refined([low, angle], [-rising, -slope], (0.01, 1e-14), |angle| -circle.slope(angle));
                best.consider(m, circle.direction(top));
            }
            (low, rising) = (angle, slope);
        }
    }
    debug_assert!(ends[count - 1] - ends[0] <= PI + 1e-9);
}

/// The best facet; segments and boxes have no other sides.
pub fn flat(m: &Difference) -> Best {
    let mut best = Best::none();
    for disc in m.discs() {
        best.consider(m, disc.axis);
    }
    for (i, first) in m.edges().iter().enumerate() {
        for second in &m.edges()[i + 1..] {
            let n = cross(first.axis, second.axis);
            let sine = norm(n);
            if sine > PARALLEL {
                best.consider(m, scale(n, 1.0 / sine));
            }
        }
    }
    best
}

/// The best of all candidates.
pub fn penetration(m: &Difference) -> Best {
    let mut best = flat(m);
    if !m.discs().is_empty() {
        for edge in 0..m.edges().len() {
            ridge(m, edge, &mut best);
        }
        curved(m, &mut best);
    }
    best
}

/// The zero of a slope that rises from `falling` at `low` to `rising` at `high`: regula falsi (Illinois). Each step leaves at least
/// the share `inset` on either side, until the ends are `close`.
pub fn refined(
    [mut low, mut high]: [f64; 2],
    [mut falling, mut rising]: [f64; 2],
    (inset, close): (f64, f64),
    slope: impl Fn(f64) -> f64,
) -> f64 {
    let mut kept = 0;
    for _ in 0..60 {
        let middle = low + (high - low) * (falling / (falling - rising)).clamp(inset, 1.0 - inset);
        let value = slope(middle);
        if value == 0.0 || high - low < close {
            return middle;
        }
        if value < 0.0 {
            (low, falling) = (middle, value);
            rising *= if kept == 1 { 0.5 } else { 1.0 };
            kept = 1;
        } else {
            (high, rising) = (middle, value);
            falling *= if kept == -1 { 0.5 } else { 1.0 };
            kept = -1;
        }
    }
    0.5 * (low + high)
}
