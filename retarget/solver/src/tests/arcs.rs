//! Arcs between orientations, against turns about one axis.

use super::random::Random;
use crate::math::{quat_axis_angle, quat_mul};
use crate::streams::smooth::along_arc;

const ANGLES: [f64; 9] = [0.0, 1e-12, 1e-9, 1e-8, 1e-7, 1e-5, 1e-3, 1.0, 3.1];

#[test]
fn an_arc_is_a_turn_about_one_axis_and_the_short_one() {
    for seed in 0..50 {
        let mut random = Random::new(seed);
        let (a, axis) = (random.turn(), random.unit());
        for (angle, share, sign) in ANGLES.iter().flat_map(|angle| {
            [0.0, 0.3, 1.0, 3.0].into_iter().flat_map(move |share| [(*angle, share, 1.0), (*angle, share, -1.0)])
        }) {
            let b = quat_mul(quat_axis_angle(axis, angle), a).map(|value| sign * value);
            let found = along_arc(a, b, share);
            let expected = quat_mul(quat_axis_angle(axis, share * angle), a);
            let off = found.iter().zip(expected).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
            assert!(off < 1e-7 && (angle > 1.0 || off < 2e-8), "seed {seed}, {angle} rad, {share}: {off}");
        }
    }
}

#[test]
fn what_is_missing_stays_missing() {
    let (a, missing) = ([1.0, 0.0, 0.0, 0.0], [f64::NAN; 4]);
    assert!(along_arc(a, missing, 1.0).iter().chain(&along_arc(missing, a, 0.0)).all(|value| value.is_nan()));
}
