//! Observers (paper, "Collision avoidance through the observer paradigm"): shapes on links that look at obstacles and at each
//! other, and add inequality rows before and after contact.
//!
//! * `set`: observers, obstacles and their pairs.
//! * `law`: modes, and the least distance of a pair at the end of a frame, as plain functions.
//! * `task`: tasks of a level of observers.
//! * `monitor`: the state of each pair.
//! * `closest`: activation of the closest approaching observer of each obstacle (paper).
//! * `budget`: activation of all observers, without the distances of pairs that cannot have come too near.
//! * `rest`: the same pairs in the posture in which the body would come to rest.
//! * `rows`: inequality rows of pairs, written into a hierarchy problem.
//! * `path`: distances of pairs along a path of postures, between its rows too; `scene` and `timed_path` are its parts.

mod budget;
mod closest;
pub mod law;
mod monitor;
pub mod path;
mod rest;
mod rows;
mod scene;
mod set;
mod task;
mod timed_path;

pub use law::Mode;
pub use monitor::PairMonitor;
pub use path::PathChecker;
pub use rows::Iteration;
pub use set::{Mover, Observer, ObserverSet, Obstacle, ObstaclePose, Other, Pair};
pub use task::{Activation, ObserverTask, ROWS};
