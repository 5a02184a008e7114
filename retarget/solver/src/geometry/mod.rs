//! Simple solids and the distance between two of them: what observers and obstacles are made of.
//!
//! Signed distance of A and B is, in every case, the largest over unit n of `n . c - h(n)`: c is A's centre seen from B's, h the
//! support function of A and B turned about, which are symmetric. Apart, the largest is the gap and is found as a nearest pair;
//! overlapping, it is minus the way out (`way_out.rs`).

mod bulky;
mod capsule_and;
mod capsules;
mod clip;
mod contact;
mod difference;
mod distance;
mod gjk;
mod half_space;
mod solid;
mod way_out;

pub use distance::{gap_at_least, nearest};
pub use half_space::extreme;
pub use solid::{Nearest, Scratch, Shape, Solid};
