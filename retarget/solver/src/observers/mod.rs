//! Observers (paper, "Collision avoidance through the observer paradigm"): shapes on links that look at obstacles and at each
//! other, and add inequality rows before and after contact.
//!
//! * `set`: which observers, obstacles and pairs there are.
//! * `law`: how near a pair may come in one frame, as plain functions.
//! * `task`: what a level of observers asks for.
//! * `watch`: what is known of each pair.
//! * `look`: distances of pairs in a posture.
//! * `budget`: pairs that cannot have come too near, whose distance need not be computed.
//! * `modes`: free, preventive or reactive, and how often that changes.
//! * `rows`: inequality rows of pairs, written into a hierarchy problem.
//! * `path`: whether a path of postures keeps pairs apart, between its rows too; `stage`, `way`, `arms` are its parts.
//! * `trial`: of those influenced by one obstacle, only the closest that approaches (paper).

mod arms;
mod budget;
pub mod law;
mod look;
mod modes;
mod path;
mod rows;
mod set;
mod stage;
mod task;
mod trial;
mod watch;
mod way;

pub use modes::Mode;
pub use path::{Ask, PathChecker};
pub use rows::Shift;
pub use set::{Mover, Observer, ObserverSet, Obstacle, ObstaclePose, Other, Pair};
pub use task::{Activation, ObserverTask};
pub use watch::Watch;
