//! Which observers and obstacles there are, and which of them are looked at together.

use crate::body::Body;
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

/// A fixture or a moving thing; where it is belongs to whoever looks.
#[derive(Clone, Debug)]
pub struct Obstacle {
    pub shape: Shape,
    pub influence: f64,
    pub margin: f64,
}

/// What an observer looks at.
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
    /// Coordinates that move one side and not the other: (coordinate, 1 or -1). What moves both cannot part them.
    pub movers: Vec<(usize, f64)>,
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
    /// `checked`: pairs of observers that are looked at; every observer looks at every obstacle.
    pub fn new(
        body: &Body,
        observers: Vec<Observer>,
        obstacles: Vec<Obstacle>,
        checked: &[(usize, usize)],
    ) -> Result<Self, String> {
        if let Some(o) = observers.iter().find(|o| o.link >= body.links.len() || o.shape == Shape::HalfSpace) {
            return Err(format!("an observer needs a link of the body and a bounded shape; found link {}", o.link));
        }
        let chain = |observer: usize| body.links[observers[observer].link].chain.as_slice();
        let mut pairs = vec![];
        for &(a, b) in checked {
            if a >= observers.len() || b >= observers.len() || a == b {
                return Err(format!("pair ({a}, {b}) is not of two of the {} observers", observers.len()));
            }
            let (first, second) = (&observers[a], &observers[b]);
            let mut movers: Vec<(usize, f64)> =
                chain(a).iter().filter(|d| !chain(b).contains(d)).map(|d| (*d, 1.0)).collect();
            movers.extend(chain(b).iter().filter(|d| !chain(a).contains(d)).map(|d| (*d, -1.0)));
            pairs.push(Pair {
                observer: a,
                other: Other::Observer(b),
                influence: first.influence.max(second.influence),
                margin: first.margin.max(second.margin),
                movers,
            });
        }
        let self_pairs = pairs.len();
        for (k, obstacle) in obstacles.iter().enumerate() {
            for (a, observer) in observers.iter().enumerate() {
                pairs.push(Pair {
                    observer: a,
                    other: Other::Obstacle(k),
                    influence: obstacle.influence.max(observer.influence),
                    margin: obstacle.margin.max(observer.margin),
                    movers: chain(a).iter().map(|d| (*d, 1.0)).collect(),
                });
            }
        }
        Ok(Self { observers, obstacles, pairs, self_pairs })
    }

    /// Where the observers are in a posture.
    pub fn place(&self, pose: &Pose, solids: &mut [Solid]) {
        for (solid, observer) in solids.iter_mut().zip(&self.observers) {
            let link = &pose.rotation[observer.link];
            solid.position = add(pose.position[observer.link], mat_vec(link, observer.position));
            solid.rotation = mat_mul(link, &observer.rotation);
        }
    }

    /// Solids of the observers, somewhere.
    pub fn new_solids(&self) -> Vec<Solid> {
        let solid = |o: &Observer| Solid { shape: o.shape, position: o.position, rotation: o.rotation };
        self.observers.iter().map(solid).collect()
    }
}
