//! Distances of solids: closed forms, proofs of optimality by support functions written anew, symmetry, continuity.

use super::random::Random;
use crate::geometry::{gap_at_least, nearest, Nearest, Scratch, Shape, Solid};
use crate::math::*;

const SEEDS: u64 = 4000;

fn solid(shape: Shape, position: Vec3, rotation: Mat3) -> Solid {
    Solid { shape, position, rotation }
}

fn between(a: &Solid, b: &Solid) -> Nearest {
    nearest(a, b, &mut Scratch::default())
}

fn ball(radius: f64) -> Shape {
    Shape::Capsule { half_length: 0.0, radius }
}

fn random_shape(random: &mut Random) -> Shape {
    let (half_length, radius) = (random.between(0.01, 0.3), random.between(0.005, 0.2));
    match random.below(6) {
        0 => ball(radius),
        1 => Shape::Capsule { half_length, radius: 0.0 },
        2 => Shape::Capsule { half_length, radius },
        3 => Shape::Cylinder { half_length, radius },
        _ => Shape::Box { half: [half_length, radius, random.between(0.01, 0.2)] },
    }
}

fn random_solid(random: &mut Random) -> Solid {
    solid(random_shape(random), random.vector(0.3), quat_to_mat(random.turn()))
}

/// The farthest that a solid reaches from its centre in the unit direction n: its support function, in its own frame.
fn reach(s: &Solid, n: Vec3) -> f64 {
    let [x, y, z] = mat_t_vec(&s.rotation, n);
    match s.shape {
        Shape::Capsule { half_length, radius } => half_length * z.abs() + radius,
        Shape::Cylinder { half_length, radius } => half_length * z.abs() + radius * x.hypot(y),
        Shape::Box { half } => half[0] * x.abs() + half[1] * y.abs() + half[2] * z.abs(),
        Shape::HalfSpace => 0.0,
    }
}

/// Separation of A and B along n, never more than their distance.
fn separation(a: &Solid, b: &Solid, n: Vec3) -> f64 {
    dot(n, sub(a.position, b.position)) - reach(a, scale(n, -1.0)) - reach(b, n)
}

/// Distance of a world point from a solid, at most `off` along any axis of it.
fn is_within(s: &Solid, p: Vec3, off: f64) -> bool {
    let [x, y, z] = mat_t_vec(&s.rotation, sub(p, s.position));
    match s.shape {
        Shape::Capsule { half_length, radius } => norm([x, y, z - z.clamp(-half_length, half_length)]) <= radius + off,
        Shape::Cylinder { half_length, radius } => x.hypot(y) <= radius + off && z.abs() <= half_length + off,
        Shape::Box { half } => x.abs() <= half[0] + off && y.abs() <= half[1] + off && z.abs() <= half[2] + off,
        Shape::HalfSpace => z <= off,
    }
}

fn assert_near(found: f64, expected: f64, what: &str) {
    assert!((found - expected).abs() < 1e-11, "{what}: found {found}, expected {expected}");
}

#[test]
fn balls() {
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let (ra, rb) = (random.between(0.01, 0.2), random.between(0.01, 0.2));
        let (a, b) = (solid(ball(ra), random.vector(0.3), IDENTITY), solid(ball(rb), random.vector(0.3), IDENTITY));
        let (from, found) = (sub(a.position, b.position), between(&a, &b));
        assert_near(found.distance, norm(from) - ra - rb, &format!("seed {seed}"));
        assert_near(norm(sub(found.normal, scale(from, 1.0 / norm(from)))), 0.0, &format!("seed {seed}: from B to A"));
    }
}

/// Distance of a point from the segment p + t axis, |t| <= half.
fn from_segment(q: Vec3, p: Vec3, axis: Vec3, half: f64) -> f64 {
    let t = dot(sub(q, p), axis).clamp(-half, half);
    norm(sub(q, add_scaled(p, axis, t)))
}

#[test]
fn capsules() {
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let size = |random: &mut Random| (random.between(0.01, 0.3), random.between(0.0, 0.1));
        let ((ha, ra), (hb, rb)) = (size(random), size(random));
        let turn = quat_to_mat(random.turn());
        // Every tenth pair is parallel.
        let other = if seed % 10 == 0 { turn } else { quat_to_mat(random.turn()) };
        let a = solid(Shape::Capsule { half_length: ha, radius: ra }, random.vector(0.3), turn);
        let b = solid(Shape::Capsule { half_length: hb, radius: rb }, random.vector(0.3), other);
        let (u, v) = (a.axis(), b.axis());
        // An end of one and the other, or both inner points of the common perpendicular.
        let mut least = f64::INFINITY;
        for side in [-1.0, 1.0] {
            least = least.min(from_segment(add_scaled(a.position, u, side * ha), b.position, v, hb));
            least = least.min(from_segment(add_scaled(b.position, v, side * hb), a.position, u, ha));
        }
        let (from, cosine) = (sub(a.position, b.position), dot(u, v));
        let sine2 = 1.0 - cosine * cosine;
        if sine2 > 1e-6 {
            let (s, t) =
                ((cosine * dot(from, v) - dot(from, u)) / sine2, (dot(from, v) - cosine * dot(from, u)) / sine2);
            if s.abs() <= ha && t.abs() <= hb {
                least = least.min(norm(sub(add_scaled(from, u, s), scale(v, t))));
            }
        }
        assert_near(between(&a, &b).distance, least - ra - rb, &format!("seed {seed}"));
    }
}

#[test]
fn anything_over_a_plane() {
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let a = random_solid(random);
        let plane = solid(Shape::HalfSpace, random.vector(0.3), quat_to_mat(random.turn()));
        let (n, found) = (plane.axis(), between(&a, &plane));
        let height = dot(n, sub(a.position, plane.position)) - reach(&a, scale(n, -1.0));
        assert_near(found.distance, height, &format!("seed {seed}"));
        assert_near(norm(sub(found.normal, n)), 0.0, &format!("seed {seed}: up"));
        assert!(is_within(&a, found.a, 1e-9) && is_within(&plane, found.b, 1e-9), "seed {seed}");
    }
}

#[test]
fn boxes_on_axes_apart_and_in_each_other() {
    let (mut apart, mut deep) = (0, 0);
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let turn = quat_to_mat(random.turn());
        let half = |random: &mut Random| -> Vec3 { std::array::from_fn(|_| random.between(0.01, 0.3)) };
        let (ha, hb, off) = (half(random), half(random), random.vector(0.5));
        let at = random.vector(1.0);
        let a = solid(Shape::Box { half: ha }, add(at, mat_vec(&turn, off)), turn);
        let b = solid(Shape::Box { half: hb }, at, turn);
        let gaps: Vec3 = std::array::from_fn(|k| off[k].abs() - ha[k] - hb[k]);
        let deepest = gaps[0].max(gaps[1]).max(gaps[2]);
        let expected = if deepest > 0.0 { norm(gaps.map(|gap| gap.max(0.0))) } else { deepest };
        let found = between(&a, &b);
        assert_near(found.distance, expected, &format!("seed {seed}"));
        if deepest <= 0.0 {
            let k = (0..3).find(|k| gaps[*k] == deepest).unwrap();
            let out = scale(column(&turn, k), off[k].signum());
            assert_near(norm(sub(found.normal, out)), 0.0, &format!("seed {seed}: the shortest way out"));
            deep += 1;
        } else {
            apart += 1;
        }
    }
    assert!(apart > 500 && deep > 500);
}

#[test]
fn a_ball_beside_and_inside_a_box() {
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let (half, radius) = ([0.2, 0.3, 0.1], random.between(0.01, 0.1));
        let (b, local) =
            (solid(Shape::Box { half }, random.vector(1.0), quat_to_mat(random.turn())), random.vector(0.4));
        let a = solid(ball(radius), add(b.position, mat_vec(&b.rotation, local)), IDENTITY);
        let over: Vec3 = std::array::from_fn(|k| local[k].abs() - half[k]);
        let deepest = over[0].max(over[1]).max(over[2]);
        let expected = if deepest > 0.0 { norm(over.map(|o| o.max(0.0))) } else { deepest };
        assert_near(between(&a, &b).distance, expected - radius, &format!("seed {seed}"));
    }
}

#[test]
fn cylinders_on_one_axis_and_beside_each_other() {
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let turn = quat_to_mat(random.turn());
        let size = |random: &mut Random| (random.between(0.01, 0.3), random.between(0.01, 0.2));
        let ((ha, ra), (hb, rb)) = (size(random), size(random));
        let off = [random.between(-0.5, 0.5), 0.0, random.between(-0.8, 0.8)];
        let a = solid(Shape::Cylinder { half_length: ha, radius: ra }, mat_vec(&turn, off), turn);
        let b = solid(Shape::Cylinder { half_length: hb, radius: rb }, [0.0; 3], turn);
        let (across, along) = (off[0].abs() - ra - rb, off[2].abs() - ha - hb);
        let deepest = across.max(along);
        let expected = if deepest > 0.0 { across.max(0.0).hypot(along.max(0.0)) } else { deepest };
        let found = between(&a, &b).distance;
        assert!((found - expected).abs() < 1e-9, "seed {seed}: found {found}, expected {expected}");
    }
}

/// The separation along the normal proves the distance from below, the points prove it from above. If the solids overlap, no direction
/// has a larger separation.
#[test]
fn every_distance_is_proved_by_its_direction_and_its_points() {
    let (mut apart, mut deep) = (0, 0);
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let (a, b) = (random_solid(random), random_solid(random));
        let Nearest { distance, a: p, b: q, normal } = between(&a, &b);
        assert!((norm(normal) - 1.0).abs() < 1e-9, "seed {seed}");
        let short = distance - separation(&a, &b, normal);
        assert!(short.abs() < 1e-8, "seed {seed}: the direction parts them by {short:e} less than {distance}");
        assert!(norm(sub(sub(p, q), scale(normal, distance))) < 1e-8, "seed {seed}: a - b = distance * normal");
        if distance > 0.0 {
            assert!(is_within(&a, p, 1e-6) && is_within(&b, q, 1e-6), "seed {seed}: points of the solids");
            apart += 1;
        } else {
            deep += 1;
        }
        for _ in 0..100 {
            let n = random.unit();
            let more = separation(&a, &b, n) - distance;
            assert!(more < 1e-9, "seed {seed}: {n:?} parts them by {more:e} more than {distance}");
        }
        assert!(gap_at_least(&a, &b) < distance + 1e-12, "seed {seed}");
    }
    assert!(apart > 500 && deep > 500, "{apart} apart, {deep} deep");
}

#[test]
fn the_way_out_leads_out() {
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let (a, b) = (random_solid(random), random_solid(random));
        let found = between(&a, &b);
        let step = 0.01 - found.distance;
        let moved = Solid { position: add_scaled(a.position, found.normal, step), ..a };
        let there = between(&moved, &b).distance;
        assert!((there - 0.01).abs() < 1e-8, "seed {seed}: {} and {step} along the normal is {there}", found.distance);
    }
}

#[test]
fn both_ways_round_it_is_the_same() {
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let (a, b) = (random_solid(random), random_solid(random));
        let (there, back) = (between(&a, &b), between(&b, &a));
        assert!((there.distance - back.distance).abs() < 1e-9, "seed {seed}");
        // Deep inside, two exits may be equally short.
        if there.distance > 1e-3 {
            assert!(norm(add(there.normal, back.normal)) < 1e-4, "seed {seed}: {there:?}, {back:?}");
        }
    }
}

/// No distance changes by more than its solids move and turn, the turn times the reach.
#[test]
fn a_small_motion_changes_it_little() {
    let mut touched = 0;
    for seed in 0..SEEDS / 10 {
        let random = &mut Random::new(seed);
        let (mut a, b) = (random_solid(random), random_solid(random));
        let mut turn = random.turn();
        a.rotation = quat_to_mat(turn);
        // Towards B, through it, and turning.
        let (motion, spin) = (scale(sub(b.position, a.position), 0.02), scale(random.unit(), 0.01));
        let mut before = between(&a, &b).distance;
        for step in 0..100 {
            turn = quat_unit(quat_mul(quat_exp(spin), turn));
            (a.position, a.rotation) = (add(a.position, motion), quat_to_mat(turn));
            let now = between(&a, &b).distance;
            let most = norm(motion) + norm(spin) * a.shape.reach();
            assert!((now - before).abs() <= most + 1e-8, "seed {seed}, step {step}: {before} to {now}, at most {most}");
            touched += usize::from(before * now <= 0.0);
            before = now;
        }
    }
    assert!(touched > 300);
}
