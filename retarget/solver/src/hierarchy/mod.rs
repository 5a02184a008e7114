//! One strict hierarchy of linear tasks (the linear problem of one iteration): a cascade of least-distance problems.
//!
//! Variables z in R^n. Level k = 1..p has rows `lower <= c . z <= upper` (an equality, a target, when lower = upper) that hold up
//! to a slack s; the box `lo <= z <= hi` is hard. Stage k, with z0 standing still:
//!
//!     min ||z - z0||^2 + ||s||^2,   lower <= c . z + mu s <= upper,   values that the levels above reached,   the box
//!
//! This is Levenberg-Marquardt damping inside the box: ||c . z - target||^2 + mu^2 ||z - z0||^2, with mu^2 = damping times the error of the
//! level (T. Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE Trans. Robotics 27(5),
//! 2011). It is strictly convex: a stage has one solution, whose sensitivity to the targets is at most 1 / (2 mu). The values that it
//! reaches become the targets of level k, so lower levels keep all remaining freedom, and every later stage has a feasible point. A last
//! stage minimises ||z||^2: a posture attraction `||W (x - x_ref)||^2` by the change of variables z = W (x - x_ref), with one more
//! variable for each soft row beside it.
//!
//! Each stage is a projection onto a polyhedron, by the dual active set of D. Goldfarb and A. Idnani ("A numerically stable dual method
//! for solving strictly convex quadratic programs", Mathematical Programming 27, 1983) with the identity as Hessian. A limit that enters
//! the active set adds a vector to an orthonormal basis, one that leaves it costs Givens rotations, and nothing is factored anew.

pub(crate) mod kernels;
mod problem;
mod stages;

pub use problem::{Problem, LEAST_DAMPING};
pub use stages::{Outcome, Stages, BUDGET};
