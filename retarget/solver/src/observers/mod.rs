//! Observers (paper, "Collision avoidance through the observer paradigm"): shapes on links that look at obstacles and at each
//! other, and add inequality rows before and after contact.
//!
//! * `set`: which observers, obstacles and pairs there are.
//! * `law`: free, preventive or reactive, and how near a pair may come in one frame, as plain functions.
//! * `task`: what a level of observers asks for.
//! * `watch`: what is known of each pair.
//! * `closest`: of those influenced by one obstacle, only the closest that approaches (paper).
//! * `budget`: pairs that cannot have come too near, whose distance need not be computed.
//! * `rest`: the same pairs where the body would come to rest.
//! * `rows`: inequality rows of pairs, written into a hierarchy problem.
//! * `path`: whether a path of postures keeps pairs apart, between its rows too; `stage` and `way` are its parts.

mod budget;
mod closest;
pub mod law;
pub mod path;
mod rest;
mod rows;
mod set;
mod stage;
mod task;
mod watch;
mod way;

pub use law::Mode;
pub use path::PathChecker;
pub use rows::Iteration;
pub use set::{Mover, Observer, ObserverSet, Obstacle, ObstaclePose, Other, Pair};
pub use task::{Activation, ObserverTask, ROWS};
pub use watch::Watch;
