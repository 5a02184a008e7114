//! Kinematics: closed forms for each kind of joint, Jacobians and centre of mass against finite differences.

use super::bodies::{chain, joint, link, random_posture, random_tree, NO_TURN};
use super::random::Random;
use crate::body::{Body, JointKind};
use crate::kinematics::Pose;
use crate::math::*;

const SEEDS: u64 = 200;
/// Step of central differences, and their largest error.
const STEP: f64 = 1e-5;
const OFF: f64 = 1e-8;

fn pose_of(body: &Body, q: &[f64]) -> Pose {
    let mut pose = body.new_pose();
    body.forward(q, &mut pose);
    body.mass_properties(&mut pose);
    pose
}

/// One link on the world by one joint.
fn on_one(kind: JointKind, axis: Vec3) -> Body {
    let links = vec![link(0, [0.0; 3], 0.0, [0.0; 3]), link(0, [0.3, -0.2, 0.1], 1.0, [0.0; 3])];
    Body::new(links, vec![joint(1, kind, axis)]).unwrap()
}

fn assert_same(found: Vec3, expected: Vec3, what: &str) {
    assert!(norm(sub(found, expected)) < 1e-12, "{what}: found {found:?}, expected {expected:?}");
}

#[test]
fn a_chain_of_hinges_is_that_of_the_textbook() {
    let (body, q) = (chain(3, 0.5), [0.3, -0.8, 1.1]);
    let pose = pose_of(&body, &q);
    let (mut at, mut angle): (Vec3, f64) = ([0.0; 3], 0.0);
    for k in 0..3 {
        assert_same(pose.position[k + 1], at, "a link's origin");
        angle += q[k];
        at = add(at, [0.5 * angle.cos(), 0.5 * angle.sin(), 0.0]);
    }
    assert_same(body.point(&pose, 3, [0.5, 0.0, 0.0]), at, "the tip");
}

#[test]
fn a_slide_goes_along_its_axis_and_a_hinge_turns_about_its_own() {
    let axis = unit_or([1.0, 2.0, -2.0], [0.0; 3]);
    let slide = pose_of(&on_one(JointKind::Slide, axis), &[0.7]);
    assert_same(slide.position[1], add_scaled([0.3, -0.2, 0.1], axis, 0.7), "slide");
    assert_eq!(slide.quat[1], NO_TURN);
    let mut body = on_one(JointKind::Hinge, axis);
    body.joints[0].pos = [0.1, 0.0, 0.0];
    let hinge = pose_of(&body, &[0.7]);
    let turn = quat_to_mat(quat_axis_angle(axis, 0.7));
    let anchor = [0.4, -0.2, 0.1];
    assert_same(hinge.position[1], sub(anchor, mat_vec(&turn, [0.1, 0.0, 0.0])), "hinge");
    assert_same(mat_vec(&hinge.rotation[1], axis), axis, "its axis stays");
}

#[test]
fn a_free_joint_moves_in_the_world_and_turns_in_its_own_frame() {
    let body = on_one(JointKind::Free, [0.0, 0.0, 1.0]);
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let (at, turn, go, spin) = (random.vector(1.0), random.turn(), random.vector(1.0), random.vector(1.0));
        let mut q = [at, [0.0; 3]].concat();
        q.truncate(3);
        q.extend_from_slice(&turn);
        body.integrate(&mut q, &[go, spin].concat());
        let pose = pose_of(&body, &q);
        assert_same(pose.position[1], add(at, go), &format!("seed {seed}"));
        // The spin is about axes of the body: seen from the world it is turned with it.
        let turned = quat_mul(quat_exp(mat_vec(&quat_to_mat(turn), spin)), turn);
        let off = quat_log(quat_mul(pose.quat[1], quat_conj(turned)));
        assert!(norm(off) < 1e-12, "seed {seed}: off by {off:?} rad");
    }
}

#[test]
fn many_small_turns_of_a_ball_joint_are_a_large_one() {
    let body = on_one(JointKind::Ball, [0.0, 0.0, 1.0]);
    for seed in 0..SEEDS {
        let random = &mut Random::new(seed);
        let (start, spin) = (random.turn(), random.vector(3.0));
        let (mut by_one, mut by_many) = (start.to_vec(), start.to_vec());
        body.integrate(&mut by_one, &spin);
        for _ in 0..1000 {
            body.integrate(&mut by_many, &scale(spin, 1e-3));
        }
        let size: f64 = by_many.iter().map(|x| x * x).sum();
        assert!((size - 1.0).abs() < 1e-14, "seed {seed}: a unit quaternion stays one");
        let mut left = [0.0; 3];
        body.difference(&by_one, &by_many, &mut left);
        assert!(norm(left) < 1e-12, "seed {seed}: off by {left:?} rad");
    }
}

#[test]
fn a_difference_undoes_an_integration() {
    for seed in 0..SEEDS {
        let (body, random) = (random_tree(seed), &mut Random::new(seed));
        let from = random_posture(&body, random);
        let dq: Vec<f64> = (0..body.nv).map(|_| random.between(-1.0, 1.0)).collect();
        let (mut to, mut found) = (from.clone(), vec![0.0; body.nv]);
        body.integrate(&mut to, &dq);
        body.difference(&from, &to, &mut found);
        for (found, dq) in found.iter().zip(&dq) {
            assert!((found - dq).abs() < 1e-12, "seed {seed}: {found} and {dq}");
        }
    }
}

#[test]
fn rest_is_where_links_are_written_down() {
    for seed in 0..SEEDS {
        let body = random_tree(seed);
        let pose = pose_of(&body, &body.rest());
        for link in &body.links[1..] {
            let parent = link.parent;
            let expected = add(pose.position[parent], mat_vec(&pose.rotation[parent], link.pos));
            let k = (0..body.links.len()).find(|k| std::ptr::eq(&body.links[*k], link)).unwrap();
            assert_same(pose.position[k], expected, &format!("seed {seed}, link {k}"));
        }
    }
}

#[test]
fn the_centre_of_mass_is_the_mean_of_its_links() {
    for seed in 0..SEEDS {
        let (body, random) = (random_tree(seed), &mut Random::new(seed));
        let pose = pose_of(&body, &random_posture(&body, random));
        let (mut sum, mut mass) = ([0.0; 3], 0.0);
        for (k, link) in body.links.iter().enumerate() {
            sum = add_scaled(sum, body.point(&pose, k, link.com), link.mass);
            mass += link.mass;
        }
        if mass > 0.0 {
            assert_same(pose.com, scale(sum, 1.0 / mass), &format!("seed {seed}"));
        }
    }
}

/// Every coordinate there and back: columns of the Jacobians of a point, of a turn and of the centre of mass.
#[test]
fn jacobians_are_finite_differences() {
    let mut kinds = [0; 4];
    for seed in 0..SEEDS {
        let (body, random) = (random_tree(seed), &mut Random::new(seed));
        body.joints.iter().for_each(|joint| kinds[joint.kind as usize] += 1);
        let q = random_posture(&body, random);
        let pose = pose_of(&body, &q);
        let (b, local) = (1 + random.below(body.links.len() - 1), random.vector(0.3));
        let point = body.point(&pose, b, local);
        for dof in 0..body.nv {
            let moved = |step: f64| {
                let (mut q, mut dq) = (q.clone(), vec![0.0; body.nv]);
                dq[dof] = step;
                body.integrate(&mut q, &dq);
                pose_of(&body, &q)
            };
            let (back, there) = (moved(-STEP), moved(STEP));
            let rate = |from: Vec3, to: Vec3| scale(sub(to, from), 0.5 / STEP);
            let turn = scale(quat_log(quat_mul(there.quat[b], quat_conj(back.quat[b]))), 0.5 / STEP);
            let of_chain = |column: Vec3| if body.links[b].chain.contains(&dof) { column } else { [0.0; 3] };
            let checks = [
                ("point", of_chain(body.point_column(&pose, dof, point)), {
                    rate(body.point(&back, b, local), body.point(&there, b, local))
                }),
                ("turn", of_chain(body.angular_column(&pose, dof)), turn),
                ("centre of mass", body.com_column(&pose, dof), rate(back.com, there.com)),
            ];
            for (what, column, difference) in checks {
                let off = norm(sub(column, difference));
                assert!(off < OFF, "seed {seed}, {what}, coordinate {dof}: {column:?}, by differences {difference:?}");
            }
        }
    }
    assert!(kinds.iter().all(|count| *count > 20), "joints of each kind: {kinds:?}");
}
