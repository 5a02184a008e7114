//! The fifteen directions along which two boxes can be kept apart (Gottschalk, Lin, Manocha, 1996): faces, and edge across edge.

use super::difference::{Best, Difference};
use crate::math::{cross, dot, scale, Vec3};

/// Sine below which two edges span no facet.
const PARALLEL: f64 = 1e-10;
/// Sine below which the products of the table have lost digits, and the gap is worked out from the direction.
const NEARLY_PARALLEL: f64 = 1e-3;
/// An edge across an edge must be better than a face by this (m), so that the choice does not flicker.
const BETTER: f64 = 1e-13;

/// The largest gap of two boxes along the directions of `way_out::flat`; `m` is in the frame of the first.
pub fn separating(m: &Difference) -> Best {
    let edges = m.edges();
    let half_a = [edges[0].half, edges[1].half, edges[2].half];
    let half_b = [edges[3].half, edges[4].half, edges[5].half];
    let axes = [edges[3].axis, edges[4].axis, edges[5].axis];
    let size = axes.map(|v| v.map(f64::abs));
    let c = m.centre;
    let mut best = Best::none();
    let mut offer = |gap: f64, direction: &dyn Fn() -> Vec3| {
        if gap > best.gap + BETTER {
            best = Best { gap, normal: direction() };
        }
    };
    for i in 0..3 {
        let gap = c[i].abs() - half_a[i] - half_b[0] * size[0][i] - half_b[1] * size[1][i] - half_b[2] * size[2][i];
        offer(gap, &|| unit(i));
    }
    for j in 0..3 {
        offer(dot(c, axes[j]).abs() - half_b[j] - dot(half_a, size[j]), &|| axes[j]);
    }
    for i in 0..3 {
        let (i1, i2) = ((i + 1) % 3, (i + 2) % 3);
        for j in 0..3 {
            let (j1, j2) = ((j + 1) % 3, (j + 2) % 3);
            let sine = (axes[j][i1] * axes[j][i1] + axes[j][i2] * axes[j][i2]).sqrt();
            if sine < PARALLEL {
                continue;
            }
            let direction = || scale(cross(unit(i), axes[j]), 1.0 / sine);
            let along = c[i2] * axes[j][i1] - c[i1] * axes[j][i2];
            let reach_a = half_a[i1] * size[j][i2] + half_a[i2] * size[j][i1];
            let reach_b = half_b[j1] * size[j2][i] + half_b[j2] * size[j1][i];
            let gap = (along.abs() - reach_a - reach_b) / sine;
            if sine < NEARLY_PARALLEL {
                let n = direction();
                offer(m.gap(n).max(m.gap(scale(n, -1.0))), &|| n);
            } else {
                offer(gap, &direction);
            }
        }
    }
    if dot(best.normal, c) < 0.0 {
        best.normal = scale(best.normal, -1.0);
    }
    best
}

fn unit(k: usize) -> Vec3 {
    let mut unit = [0.0; 3];
    unit[k] = 1.0;
    unit
}
