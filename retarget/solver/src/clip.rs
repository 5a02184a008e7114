//! Many frames in a row.

use crate::frame::FrameSolver;

impl FrameSolver {
    /// A row of `targets` and a row of `postures` (nq) for each frame of `dt` seconds. A clip begins with the active set with which the
    /// clip before began: where one is made in every tick, as a way to a stop is, it begins much alike.
    pub fn clip(&mut self, targets: &[f64], dt: f64, postures: &mut [f64]) {
        self.first_sides.clone_from(&self.clip_sides);
        let rows = targets.chunks_exact(self.target_size.max(1));
        for (t, (row, posture)) in rows.zip(postures.chunks_exact_mut(self.body.nq)).enumerate() {
            self.frame(row, dt);
            posture.copy_from_slice(&self.q);
            if t == 0 {
                self.clip_sides.clone_from(&self.first_sides);
            }
        }
    }
}
