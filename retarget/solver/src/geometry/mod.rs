//! Simple solids, the shapes of observers and obstacles, and the distance between two of them.
//!
//! Signed distance of A and B is, in every case, the largest over unit n of `n . c - h(n)`: c is A's centre seen from B's, h the
//! support function of A and B turned about, which are symmetric. Apart, the largest is the gap and is found as a nearest pair;
//! overlapping, it is minus the penetration depth (`penetration.rs`).

mod box_cylinder;
mod capsule_solid;
mod capsules;
mod clip;
mod contact;
mod difference;
mod distance;
mod gjk;
mod half_space;
mod penetration;
mod solid;

pub use distance::{gap_at_least, nearest};
pub use half_space::extreme;
pub use solid::{Nearest, Scratch, Shape, Solid};
