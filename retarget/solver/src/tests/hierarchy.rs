//! The linear problem of one iteration: strict, optimal level by level, never infeasible, the same bits every time.

use super::cone::{basis, distance, dot};
use super::random::Random;
use crate::hierarchy::{solve, Outcome, Problem, Side, Workspace};

const SEEDS: u64 = 1500;
/// What is held counts as held within this.
const HELD: f64 = 1e-8;

/// A level: rows with their lower and upper limits.
type Level = Vec<(Vec<f64>, f64, f64)>;

struct Hierarchy {
    levels: Vec<Level>,
    lo: Vec<f64>,
    hi: Vec<f64>,
}

/// Equalities, inequalities of one side and of two, rows that depend on others, limits that are met at once, tight or none.
fn random_hierarchy(seed: u64) -> Hierarchy {
    let random = &mut Random::new(seed);
    let n = 2 + random.below(18);
    let size = 0.1 + random.between(0.0, 2.0);
    let bounds: Vec<(f64, f64)> = (0..n)
        .map(|_| {
            let middle = if random.chance(0.3) { random.between(-size, size) } else { 0.0 };
            match random.below(8) {
                0 => (f64::NEG_INFINITY, f64::INFINITY),
                1 => (middle, middle),
                2 => (middle, f64::INFINITY),
                _ => (middle - random.between(0.0, size), middle + random.between(0.0, size)),
            }
        })
        .collect();
    let mut known: Vec<Vec<f64>> = vec![];
    let levels = (0..1 + random.below(5)).map(|_| random_level(random, n, &mut known)).collect();
    Hierarchy { levels, lo: bounds.iter().map(|b| b.0).collect(), hi: bounds.iter().map(|b| b.1).collect() }
}

fn random_level(random: &mut Random, n: usize, known: &mut Vec<Vec<f64>>) -> Level {
    let (rows, limits) = (random.below(9), random.chance(0.7));
    (0..rows)
        .map(|_| {
            let row: Vec<f64> = match random.below(6) {
                0 if known.len() > 1 => {
                    let (a, b) = (random.below(known.len()), random.below(known.len()));
                    let (s, t) = (random.normal(), if random.chance(0.5) { random.normal() } else { 0.0 });
                    known[a].iter().zip(&known[b]).map(|(a, b)| s * a + t * b).collect()
                }
                1 => (0..n).map(|_| if random.chance(0.3) { random.normal() } else { 0.0 }).collect(),
                _ => (0..n).map(|_| random.normal()).collect(),
            };
            known.push(row.clone());
            let value = random.normal();
            match random.below(5) {
                0 if limits => (row, value, f64::INFINITY),
                1 if limits => (row, f64::NEG_INFINITY, value),
                2 if limits => (row, value, value + random.between(0.0, 1.0)),
                _ => (row, value, value),
            }
        })
        .collect()
}

impl Hierarchy {
    /// Of the first `count` levels.
    fn problem(&self, count: usize) -> Problem {
        let levels = &self.levels[..count];
        let mut problem = Problem::new(self.lo.len(), &levels.iter().map(Vec::len).collect::<Vec<_>>());
        for (r, (row, lower, upper)) in levels.iter().flatten().enumerate() {
            problem.row_mut(r)[..row.len()].copy_from_slice(row);
            (problem.lower[r], problem.upper[r], problem.present[r]) = (*lower, *upper, true);
        }
        problem.lo.copy_from_slice(&self.lo);
        problem.hi.copy_from_slice(&self.hi);
        problem
    }

    fn solved(&self, count: usize) -> (Vec<f64>, Outcome) {
        let mut problem = self.problem(count);
        let outcome = solve(&mut problem, &mut Workspace::default());
        (problem.z[..self.lo.len()].to_vec(), outcome)
    }

    fn residual(&self, level: usize, z: &[f64]) -> f64 {
        self.levels[level].iter().map(|row| beyond(row, z).powi(2)).sum::<f64>().sqrt()
    }

    fn inside(&self, z: &[f64]) -> bool {
        z.iter().zip(&self.lo).zip(&self.hi).all(|((z, lo), hi)| z.is_finite() && lo <= z && z <= hi)
    }
}

/// How far a row is beyond its upper limit; negative: beyond its lower one.
fn beyond((row, lower, upper): &(Vec<f64>, f64, f64), z: &[f64]) -> f64 {
    let value = dot(row, z);
    (value - upper).max(0.0) + (value - lower).min(0.0)
}

/// How far z is from meeting the first-order conditions of any level, and of the least norm below all of them.
///
/// Level k minimises half the square of its violations among points that keep what levels above violate as it is, what they do not
/// violate within its limits, and the box. So minus its gradient is in the cone of the normals of what is held.
fn unmet_conditions(hierarchy: &Hierarchy, z: &[f64]) -> f64 {
    let n = z.len();
    let unit = |i: usize, sign: f64| (0..n).map(|k| if k == i { sign } else { 0.0 }).collect::<Vec<f64>>();
    let (mut fixed, mut held): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (vec![], vec![]);
    for i in 0..n {
        let (at_lo, at_hi) = (z[i] - hierarchy.lo[i] <= HELD, hierarchy.hi[i] - z[i] <= HELD);
        if hierarchy.lo[i] == hierarchy.hi[i] {
            fixed.push(unit(i, 1.0));
        } else if at_lo {
            held.push(unit(i, -1.0));
        } else if at_hi {
            held.push(unit(i, 1.0));
        }
    }
    let mut worst: f64 = 0.0;
    for k in 0..=hierarchy.levels.len() {
        let downhill: Vec<f64> = match hierarchy.levels.get(k) {
            Some(level) => (0..n).map(|i| -level.iter().map(|row| beyond(row, z) * row.0[i]).sum::<f64>()).collect(),
            None => z.iter().map(|v| -v).collect(),
        };
        worst = worst.max(distance(&downhill, &held, &basis(&fixed)));
        for row in hierarchy.levels.get(k).into_iter().flatten() {
            let value = dot(&row.0, z);
            if row.1 == row.2 || beyond(row, z).abs() > HELD {
                fixed.push(row.0.clone());
            } else if (value - row.2).abs() <= HELD {
                held.push(row.0.clone());
            } else if (value - row.1).abs() <= HELD {
                held.push(row.0.iter().map(|c| -c).collect());
            }
        }
    }
    worst
}

#[test]
fn every_answer_meets_the_conditions_of_every_level() {
    let (mut held, mut unmet) = (0, 0);
    for seed in 0..SEEDS {
        let hierarchy = random_hierarchy(seed);
        let (z, outcome) = hierarchy.solved(hierarchy.levels.len());
        assert!(hierarchy.inside(&z) && !outcome.capped, "seed {seed}");
        let worst = unmet_conditions(&hierarchy, &z);
        assert!(worst < 1e-7, "seed {seed}: a level could be better by a step along {worst:e}");
        held += usize::from((0..z.len()).any(|i| z[i] == hierarchy.lo[i] || z[i] == hierarchy.hi[i]));
        unmet += usize::from((0..hierarchy.levels.len()).any(|k| hierarchy.residual(k, &z) > 1e-3));
    }
    assert!(held > 500 && unmet > 500, "limits matter in {held}, levels are unmet in {unmet} of {SEEDS}");
}

#[test]
fn the_conditions_detect_a_worse_answer() {
    let mut detected = 0;
    for seed in 0..200 {
        let hierarchy = random_hierarchy(seed);
        let (mut z, _) = hierarchy.solved(hierarchy.levels.len());
        let Some(i) = (0..z.len()).find(|i| hierarchy.hi[*i] - hierarchy.lo[*i] > 0.05) else { continue };
        z[i] += if hierarchy.hi[i] - z[i] > 0.02 { 0.01 } else { -0.01 };
        assert!(unmet_conditions(&hierarchy, &z) > 1e-6, "seed {seed}");
        detected += 1;
    }
    assert!(detected > 150);
}

#[test]
fn a_lower_level_changes_no_higher_residual() {
    for seed in 0..SEEDS {
        let hierarchy = random_hierarchy(seed);
        let answers: Vec<_> = (0..=hierarchy.levels.len()).map(|count| hierarchy.solved(count).0).collect();
        for (count, z) in answers.iter().enumerate().skip(1) {
            for level in 0..count - 1 {
                let change = hierarchy.residual(level, z) - hierarchy.residual(level, &answers[count - 1]);
                assert!(change.abs() <= 1e-9, "seed {seed}: level {} changes level {level} by {change:e}", count - 1);
            }
        }
    }
}

#[test]
fn the_answer_does_not_depend_on_the_guess() {
    for seed in 0..SEEDS {
        let hierarchy = random_hierarchy(seed);
        let cold = hierarchy.solved(hierarchy.levels.len()).0;
        let mut problem = hierarchy.problem(hierarchy.levels.len());
        guess(&mut problem, &mut Random::new(seed));
        solve(&mut problem, &mut Workspace::default());
        for (warm, cold) in problem.z.iter().zip(&cold) {
            assert!((warm - cold).abs() < 1e-7, "seed {seed}: {warm} and {cold}");
        }
    }
}

/// Any sides and any start.
fn guess(problem: &mut Problem, random: &mut Random) {
    let sides = [Side::Free, Side::Lower, Side::Upper, Side::Both];
    for side in problem.variable_side.iter_mut().chain(&mut problem.row_side) {
        *side = sides[random.below(4)];
    }
    for i in 0..problem.n {
        problem.z[i] = random.normal();
    }
}

/// Limits that nothing can meet, and numbers of every size.
fn ugly_problem(seed: u64) -> Problem {
    let random = &mut Random::new(seed);
    let n = 1 + random.below(12);
    let rows: Vec<usize> = (0..random.below(5)).map(|_| random.below(8)).collect();
    let mut problem = Problem::new(n, &rows);
    let number = |random: &mut Random| random.normal() * 10f64.powi(random.below(13) as i32 - 6);
    for r in 0..problem.row_count() {
        let kind = random.below(5);
        for i in 0..n {
            problem.row_mut(r)[i] = match kind {
                0 => 0.0,
                1 if r > 0 => problem.row(r - 1)[i] * (1.0 + 1e-9 * random.normal()),
                _ => number(random),
            };
        }
        let (a, b) = (number(random), number(random));
        (problem.lower[r], problem.upper[r]) = match random.below(4) {
            0 => (a.min(b), a.max(b)),
            1 => (a, f64::INFINITY),
            _ => (a, a),
        };
        problem.present[r] = random.chance(0.9);
    }
    for i in 0..n {
        let (a, b) = (number(random), number(random));
        (problem.lo[i], problem.hi[i]) = match random.below(5) {
            0 => (a, a),
            1 => (a, f64::INFINITY),
            2 => (f64::NEG_INFINITY, f64::INFINITY),
            _ => (a.min(b), a.max(b)),
        };
        problem.still[i] = number(random);
        (problem.lo_is_stop[i], problem.hi_is_stop[i]) = (random.chance(0.5), random.chance(0.5));
    }
    if random.chance(0.5) {
        problem.damping.iter_mut().for_each(|d| *d = random.between(0.0, 1.0));
        problem.patience.iter_mut().for_each(|p| *p = random.between(0.0, 1.0));
    }
    guess(&mut problem, random);
    problem
}

#[test]
fn any_problem_has_a_finite_answer_inside_the_box() {
    for seed in 0..2 * SEEDS {
        let mut problem = ugly_problem(seed);
        solve(&mut problem, &mut Workspace::default());
        for i in 0..problem.n {
            let (z, lo, hi) = (problem.z[i], problem.lo[i], problem.hi[i]);
            assert!(z.is_finite() && lo <= z && z <= hi, "seed {seed}: {lo} <= {z} <= {hi}");
        }
    }
}

#[test]
fn the_same_bits_every_time_in_any_work_space() {
    let used = &mut Workspace::default();
    for seed in 0..SEEDS {
        let mut problems = [ugly_problem(seed), ugly_problem(seed), ugly_problem(seed)];
        let spaces = [&mut Workspace::default(), &mut Workspace::default(), &mut *used];
        let outcomes: Vec<Outcome> = problems.iter_mut().zip(spaces).map(|(p, work)| solve(p, work)).collect();
        let bits = |p: &Problem| p.z.iter().map(|z| z.to_bits()).collect::<Vec<_>>();
        for k in 1..3 {
            assert!(bits(&problems[0]) == bits(&problems[k]) && outcomes[0] == outcomes[k], "seed {seed}, run {k}");
            assert!(problems[0].row_side == problems[k].row_side, "seed {seed}, run {k}");
        }
    }
}
