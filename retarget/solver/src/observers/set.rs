//! Observers, obstacles, and the pairs of them that are checked.

use crate::body::{Body, Joint, JointKind};
use crate::geometry::{Shape, Solid};
use crate::kinematics::Pose;
use crate::math::*;

/// A shape on a link. `influence`: distance from which it acts; `margin`: distance that it keeps, m.
#[derive(Clone, Debug)]
pub struct Observer {
    pub link: usize,
    pub shape: Shape,
    pub position: Vec3,
    pub rotation: Mat3,
    pub influence: f64,
    pub margin: f64,
}

/// A fixture or a moving thing; its pose belongs to the caller.
#[derive(Clone, Debug)]
pub struct Obstacle {
    pub shape: Shape,
    pub influence: f64,
    pub margin: f64,
}

/// Pose and velocity (m/s, rad/s, world frame) of an obstacle at the start of a frame.
#[derive(Clone, Copy, Debug)]
pub struct ObstaclePose {
    pub position: Vec3,
    pub quat: Quat,
    pub linear: Vec3,
    pub angular: Vec3,
}

impl ObstaclePose {
    /// At the origin, at rest.
    pub const REST: Self = Self { position: [0.0; 3], quat: [1.0, 0.0, 0.0, 0.0], linear: [0.0; 3], angular: [0.0; 3] };

    pub fn moves(&self) -> bool {
        self.linear != [0.0; 3] || self.angular != [0.0; 3]
    }

    /// The same, `time` s later.
    pub fn after(&self, time: f64) -> Self {
        if !self.moves() {
            return *self;
        }
        let position = add(self.position, scale(self.linear, time));
        Self { position, quat: quat_unit(quat_mul(quat_exp(scale(self.angular, time)), self.quat)), ..*self }
    }
}

/// Place the solids of obstacles as they are `time` s later.
pub fn place_obstacles(obstacles: &[ObstaclePose], time: f64, solids: &mut [Solid]) {
    for (solid, obstacle) in solids.iter_mut().zip(obstacles) {
        let there = obstacle.after(time);
        (solid.position, solid.rotation) = (there.position, quat_to_mat(there.quat));
    }
}

/// The thing that an observer looks at.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Other {
    Observer(usize),
    Obstacle(usize),
}

/// An observer and what it looks at. The larger influence and the larger margin of the two act.
#[derive(Clone, Debug)]
pub struct Pair {
    pub observer: usize,
    pub other: Other,
    pub influence: f64,
    pub margin: f64,
    /// Coordinates that move one side and not the other.
    pub movers: Vec<Mover>,
}

/// A coordinate that moves one side of a pair.
#[derive(Clone, Copy, Debug)]
pub struct Mover {
    pub dof: usize,
    /// 1 if it moves the observer, -1 if it moves the other side.
    pub sign: f64,
    /// Greatest distance of the side's shape from the coordinate's axis in any posture, m; 1 for a slide; infinite if it is not known.
    pub lever: f64,
}

#[derive(Clone, Debug, Default)]
pub struct ObserverSet {
    pub observers: Vec<Observer>,
    pub obstacles: Vec<Obstacle>,
    /// Observers with each other first, then with obstacles.
    pub pairs: Vec<Pair>,
    /// Number of pairs of observers.
    pub self_pairs: usize,
}

impl ObserverSet {
    /// `checked`: pairs of observers; `around`: pairs of an observer and an obstacle; each with the largest margin that it keeps.
    pub fn new(
        body: &Body,
        observers: Vec<Observer>,
        obstacles: Vec<Obstacle>,
        checked: &[(usize, usize, f64)],
        around: &[(usize, usize, f64)],
    ) -> Result<Self, String> {
        if let Some(o) = observers.iter().find(|o| o.link >= body.links.len() || o.shape == Shape::HalfSpace) {
            return Err(format!("an observer needs a link of the body and a bounded shape; found link {}", o.link));
        }
        let chain = |observer: usize| body.links[observers[observer].link].chain.as_slice();
        let movers = |moved: usize, sign: f64, other: &[usize]| {
            let own = chain(moved).iter().filter(|dof| !other.contains(dof));
            own.map(|&dof| Mover { dof, sign, lever: lever(body, &observers[moved], dof) }).collect::<Vec<_>>()
        };
        let mut pairs = vec![];
        for &(a, b, most) in checked {
            if a >= observers.len() || b >= observers.len() || a == b {
                return Err(format!("pair ({a}, {b}) is not of two of the {} observers", observers.len()));
            }
            let (first, second) = (&observers[a], &observers[b]);
            let mut both = movers(a, 1.0, chain(b));
            both.extend(movers(b, -1.0, chain(a)));
            pairs.push(Pair {
                observer: a,
                other: Other::Observer(b),
                influence: first.influence.max(second.influence),
                margin: first.margin.max(second.margin).min(most),
                movers: both,
            });
        }
        let self_pairs = pairs.len();
        for &(a, k, most) in around {
            if a >= observers.len() || k >= obstacles.len() {
                let (n, m) = (observers.len(), obstacles.len());
                return Err(format!("pair ({a}, {k}) is not of one of the {n} observers and one of the {m} obstacles"));
            }
            let (observer, obstacle) = (&observers[a], &obstacles[k]);
            pairs.push(Pair {
                observer: a,
                other: Other::Obstacle(k),
                influence: obstacle.influence.max(observer.influence),
                margin: obstacle.margin.max(observer.margin).min(most),
                movers: movers(a, 1.0, &[]),
            });
        }
        Ok(Self { observers, obstacles, pairs, self_pairs })
    }

    /// Place the solids of the observers in a pose.
    pub fn place(&self, pose: &Pose, solids: &mut [Solid]) {
        for (solid, observer) in solids.iter_mut().zip(&self.observers) {
            let link = &pose.rotation[observer.link];
            solid.position = add(pose.position[observer.link], mat_vec(link, observer.position));
            solid.rotation = mat_mul(link, &observer.rotation);
        }
    }

    /// Solids of both sides of a pair.
    pub fn sides<'a>(&self, pair: usize, solids: &'a [Solid], fixtures: &'a [Solid]) -> (&'a Solid, &'a Solid) {
        let pair = &self.pairs[pair];
        match pair.other {
            Other::Observer(o) => (&solids[pair.observer], &solids[o]),
            Other::Obstacle(o) => (&solids[pair.observer], &fixtures[o]),
        }
    }

    /// Solids of the observers, not yet placed.
    pub fn new_solids(&self) -> Vec<Solid> {
        let solid = |o: &Observer| Solid { shape: o.shape, position: o.position, rotation: o.rotation };
        self.observers.iter().map(solid).collect()
    }

    /// Solids of the obstacles, not yet placed.
    pub fn new_fixtures(&self) -> Vec<Solid> {
        let solid = |o: &Obstacle| Solid { shape: o.shape, position: [0.0; 3], rotation: IDENTITY };
        self.obstacles.iter().map(solid).collect()
    }
}

/// Greatest distance of an observer's shape from the axis of a coordinate in its chain, in any posture.
fn lever(body: &Body, observer: &Observer, dof: usize) -> f64 {
    let slides = |later: &usize| *later > dof && body.dof_linear[*later];
    match body.dof_linear[dof] {
        true => 1.0,
        // A slide after the joint moves the shape away from it.
        false if body.links[observer.link].chain.iter().any(slides) => f64::INFINITY,
        false => arm(body, dof, observer),
    }
}

/// Length (m) along the body from a joint to the farthest point of an observer. No posture takes it farther, if no joint in between
/// slides.
pub fn arm(body: &Body, dof: usize, observer: &Observer) -> f64 {
    let joint = dof_joint(body, dof);
    let from = body.joints[joint].body;
    let later = &body.joints[joint + 1..body.links[from].joints.1];
    let off: f64 = norm(body.joints[joint].pos) + later.iter().map(|j| 2.0 * norm(j.pos)).sum::<f64>();
    off + link_distance(body, from, observer.link) + norm(observer.position) + observer.shape.reach()
}

pub fn dof_joint(body: &Body, dof: usize) -> usize {
    body.joints.iter().rposition(|j| j.v_address <= dof).unwrap_or(0)
}

/// Length (m) along the body from the origin of one link to that of another, with slides at rest. A turn about a point swings the
/// origin of its link around it.
fn link_distance(body: &Body, from: usize, to: usize) -> f64 {
    let swung = |joint: &Joint| if joint.kind == JointKind::Slide { 0.0 } else { 2.0 * norm(joint.pos) };
    let (mut a, mut b, mut length) = (from, to, 0.0);
    while a != b {
        let lower = if a > b { &mut a } else { &mut b };
        let link = &body.links[*lower];
        length += norm(link.pos) + body.joints[link.joints.0..link.joints.1].iter().map(swung).sum::<f64>();
        *lower = link.parent;
    }
    length
}
