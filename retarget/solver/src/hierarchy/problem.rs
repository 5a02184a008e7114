//! The data of one hierarchy: levels of rows, a box, and the damping of levels.

/// Least damping of a level whose rows are in metres or radians.
pub const LEAST_DAMPING: f64 = 1e-3;

#[derive(Clone, Debug, Default)]
pub struct Problem {
    /// Variables, and the padded row length (a multiple of 8).
    pub n: usize,
    pub stride: usize,
    /// Rows, `stride` apart; padding is zero.
    pub rows: Vec<f64>,
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
    /// Rows of level k: `level_end[k-1]..level_end[k]`.
    pub level_end: Vec<usize>,
    /// A row that is not present takes no part.
    pub present: Vec<bool>,
    /// The box.
    pub lo: Vec<f64>,
    pub hi: Vec<f64>,
    /// The z of no motion, from which damped steps are measured. A posture that attracts makes it other than 0.
    pub still: Vec<f64>,
    /// Squared damping of a level for each unit of its error, and its least damping, in units of its rows. Without it, rows that
    /// cannot all be met would need infinite forces.
    pub damping: f64,
    pub least_damping: f64,
    /// Squared error of each level. Its targets may correct less.
    pub error2: Vec<f64>,
    /// Rounds of a stage, each from the solution before: 1. More drive damping to nothing (the proximal point method), for tests.
    pub rounds: usize,
    /// Rows of the last level have a variable of their own each, so that all of them can be met.
    pub soft_last: bool,
    /// The solution, and the rows that limited it in any stage.
    pub z: Vec<f64>,
    pub held: Vec<bool>,
}

impl Problem {
    /// A problem of `n` variables and `level_rows[k]` rows in level k; every entry is zero, every row absent.
    pub fn new(n: usize, level_rows: &[usize]) -> Self {
        let level_end = level_rows
            .iter()
            .scan(0, |end, rows| {
                *end += rows;
                Some(*end)
            })
            .collect::<Vec<_>>();
        let m = level_end.last().copied().unwrap_or(0);
        let stride = n.div_ceil(8).max(1) * 8;
        Self {
            n,
            stride,
            rows: vec![0.0; m * stride],
            lower: vec![0.0; m],
            upper: vec![0.0; m],
            level_end,
            present: vec![false; m],
            lo: vec![f64::NEG_INFINITY; n],
            hi: vec![f64::INFINITY; n],
            still: vec![0.0; stride],
            damping: 0.0,
            least_damping: LEAST_DAMPING,
            error2: vec![0.0; level_rows.len()],
            rounds: 1,
            soft_last: false,
            z: vec![0.0; stride],
            held: vec![false; m],
        }
    }

    #[inline(always)]
    pub fn row(&self, r: usize) -> &[f64] {
        &self.rows[r * self.stride..(r + 1) * self.stride]
    }

    #[inline(always)]
    pub fn row_mut(&mut self, r: usize) -> &mut [f64] {
        &mut self.rows[r * self.stride..(r + 1) * self.stride]
    }

    pub fn row_count(&self) -> usize {
        self.lower.len()
    }

    pub fn level_count(&self) -> usize {
        self.level_end.len()
    }

    #[inline(always)]
    pub fn level(&self, k: usize) -> std::ops::Range<usize> {
        let start = if k == 0 { 0 } else { self.level_end[k - 1] };
        start..self.level_end[k]
    }

    #[inline(always)]
    pub fn is_equality(&self, r: usize) -> bool {
        self.lower[r] == self.upper[r]
    }
}
