//! The best direction nearby: Newton's method on the unit sphere, where no edge is met.

use super::difference::{Best, Difference};
use crate::math::{add, add_scaled, cross, dot, norm, perpendicular, scale, Vec3};

const STEPS: usize = 30;
const HALVINGS: usize = 12;
/// A step (rad) after which Newton's method has converged.
const CLOSE: f64 = 1e-6;
/// Directions tried for a way out between two discs, and how many of the best are followed.
const STARTS: usize = 64;
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
        let k = disc.radius / sine.max(1e-12).powi(3);
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
    let shrink = 1.0 / (1.0 + 2.0 * x.hypot(y));
    [x * shrink, y * shrink]
}

fn moved(n: Vec3, basis: [Vec3; 2], x: f64, y: f64) -> Vec3 {
    let there = add_scaled(add_scaled(n, basis[0], x), basis[1], y);
    scale(there, 1.0 / norm(there))
}

/// The unit direction near n from which no small step enlarges the gap; with `edge`, of those across it.
pub fn climb(m: &Difference, mut n: Vec3, edge: Option<Vec3>) -> Vec3 {
    let mut gap = m.gap(n);
    for _ in 0..STEPS {
        let basis = match edge {
            Some(axis) => [cross(axis, n), [0.0; 3]],
            None => [perpendicular(n), cross(n, perpendicular(n))],
        };
        let [mut x, mut y] = step(m, n, gap, basis);
        if x.hypot(y) < CLOSE {
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

/// Ways out where two discs bend the side both ways: climb from the best of directions spread over the sphere.
pub fn curved(m: &Difference, best: &mut Best) {
    if m.discs().len() < 2 {
        return;
    }
    let mut found = [(f64::NEG_INFINITY, best.normal); FOLLOWED];
    for k in 0..STARTS {
        // Fibonacci's spiral over the half of the sphere.
        let z = (k as f64 + 0.5) / STARTS as f64;
        let (s, c) = (2.399_963_229_728_653 * k as f64).sin_cos();
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
    // Between the normals of discs that are nearly parallel there is little room, and no start.
    let (first, second) = (m.discs()[0].axis, m.discs()[1].axis);
    let second = scale(second, 1f64.copysign(dot(first, second)));
    for share in [0.1, 0.3, 0.5, 0.7, 0.9] {
        let n = add(scale(first, 1.0 - share), scale(second, share));
        let n = scale(n, 1f64.copysign(dot(n, m.centre)) / norm(n));
        best.consider(m, climb(m, n, None));
    }
    best.consider(m, climb(m, best.normal, None));
}
