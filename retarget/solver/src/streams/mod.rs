//! Stream filters for the poses of a performer's sensors, between a decoder and the virtual human, a whole frame in one call. They share
//! only vectors and quaternions with the solver. They are native because they run in every tick and on every frame that comes in
//! (`docs/live.md`).
//!
//! In the order of the data:
//!
//! * `sensor_plan`: sensors from the poses of a sender, and poses that come in parts.
//! * `validity`: validity of poses, and the state of every sensor.
//! * `playout`: poses of many capture times, read at one.
//! * `smooth`: arcs between orientations, and the One-Euro filter.
//! * `python`: the bindings of all of them.
//!
//! Times are seconds of one clock, which the caller reads. NaN stands for a part that was not sent.

pub mod playout;
#[cfg(feature = "python")]
pub mod python;
pub mod sensor_plan;
pub mod smooth;
pub mod validity;
