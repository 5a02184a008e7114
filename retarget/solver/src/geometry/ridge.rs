//! Ways out across one edge that sweeps a disc: the largest gap over the directions perpendicular to that edge.

use super::difference::{Best, Difference};
use crate::math::{add_scaled, cross, dot, perpendicular, scale, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Parts into which every smooth arc is cut to find where the slope turns.
const PARTS: usize = 4;
/// From an end of an arc, where the slope jumps, to where it is read (share of the arc).
const INSET: f64 = 1e-9;
/// Ends of arcs: two of the half circle, one for each other edge, two for each disc.
const MOST: usize = 2 + 5 + 4;

/// The half of the circle across an edge that looks towards A.
struct Circle<'a> {
    m: &'a Difference,
    ahead: Vec3,
    aside: Vec3,
}

impl Circle<'_> {
    fn direction(&self, angle: f64) -> Vec3 {
        let (s, c) = angle.sin_cos();
        add_scaled(scale(self.ahead, c), self.aside, s)
    }

    /// Derivative of the gap.
    fn slope(&self, angle: f64) -> f64 {
        let (s, c) = angle.sin_cos();
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
            (-x / y).atan()
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

    /// Where the slope falls through zero between `low` (rising) and `high` (falling): regula falsi (Illinois), safeguarded.
    fn top(&self, mut low: f64, mut rising: f64, mut high: f64, mut falling: f64) -> f64 {
        let mut kept = 0;
        for _ in 0..60 {
            let middle = low + (high - low) * (rising / (rising - falling)).clamp(0.01, 0.99);
            let slope = self.slope(middle);
            if slope == 0.0 || high - low < 1e-14 {
                return middle;
            }
            if slope > 0.0 {
                (low, rising) = (middle, slope);
                falling *= if kept == 1 { 0.5 } else { 1.0 };
                kept = 1;
            } else {
                (high, falling) = (middle, slope);
                rising *= if kept == -1 { 0.5 } else { 1.0 };
                kept = -1;
            }
        }
        0.5 * (low + high)
    }
}

/// Offer `best` every top of the gap over the directions across `edge`.
pub fn ridge(m: &Difference, edge: usize, best: &mut Best) {
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
                best.consider(m, circle.direction(circle.top(low, rising, angle, slope)));
            }
            (low, rising) = (angle, slope);
        }
    }
    debug_assert!(ends[count - 1] - ends[0] <= PI + 1e-9);
}
