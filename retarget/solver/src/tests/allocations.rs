//! Nothing is allocated in a frame, a solve or a check after the first ones. Run with `--features count-allocations`.

use super::bodies::{chain, humanoid, Humanoid};
use super::random::Random;
use crate::body::Body;
use crate::braking::Limit;
use crate::frame::{FrameSolver, Settings};
use crate::geometry::Shape;
use crate::hierarchy::{Problem, Stages, BUDGET};
use crate::observers::{Activation, Mode, Observer, ObserverSet, ObserverTask, Obstacle, ObstaclePose, PathChecker};
use crate::task::{Task, TaskKind};
use crate::trajectory::{MotionLimit, TrajectoryGenerator};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::hint::black_box;
use std::sync::Arc;

const DT: f64 = 0.02;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count_one() {
    // A thread that ends may allocate after its locals are gone; such an allocation is not counted.
    let _ = COUNT.try_with(|count| count.set(count.get() + 1));
}

// SAFETY: everything is handed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_one();
        System.alloc(layout)
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count_one();
        System.alloc_zeroed(layout)
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count_one();
        System.realloc(pointer, layout, size)
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        System.dealloc(pointer, layout);
    }
}

/// Allocations of this thread so far.
fn allocations() -> u64 {
    COUNT.with(Cell::get)
}

/// Number of allocations that `work` makes.
fn counted(work: impl FnOnce()) -> u64 {
    let before = allocations();
    work();
    allocations() - before
}

#[test]
fn an_allocation_is_counted() {
    assert_eq!(counted(|| drop(black_box(Box::new(1.0)))), 1);
    let mut numbers: Vec<f64> = Vec::with_capacity(1);
    assert_eq!(counted(|| black_box(&mut numbers).push(1.0)), 0);
    assert_eq!(counted(|| black_box(&mut numbers).resize(100, 1.0)), 1);
    assert_eq!(counted(|| drop(black_box(vec![0.0; 100]))), 1);
}

fn task(kind: TaskKind, rows: usize) -> Task {
    Task { kind, weight: vec![1.0; rows], gain: 1.0, max_error: 0.05 }
}

fn posture(body: &Body) -> Task {
    Task { gain: 0.05, max_error: 0.3, ..task(TaskKind::Posture, body.nv) }
}

fn settings() -> Settings {
    Settings { n_ik: 5, max_step: 0.3, damping: 1.0, early_stop: true }
}

/// Targets: every task present, with these values behind its weight.
fn targets(solver: &FrameSolver, values: &[Vec<f64>]) -> Vec<f64> {
    let mut all = vec![0.0; solver.target_size];
    for ((_, place), value) in solver.slices().zip(values) {
        all[place.start] = 1.0;
        all[place.start + 1..place.end].copy_from_slice(value);
    }
    all
}

/// In reach and out of it in turns, so that damping begins in the middle, on feet that are planted by nothing but tasks.
fn run_humanoid(robot: &Humanoid, levels: Vec<Vec<Task>>, fixed: &[Vec<f64>]) -> (FrameSolver, Vec<u64>) {
    let body = Arc::new(robot.body.clone());
    let mut limits = vec![Limit { lower: -1.5, upper: 1.5, velocity: 4.5, acceleration: f64::INFINITY }; body.nv];
    limits[..6].fill(Limit {
        lower: -f64::INFINITY,
        upper: f64::INFINITY,
        velocity: f64::INFINITY,
        acceleration: f64::INFINITY,
    });
    let locked = vec![false; body.nv];
    let mut solver = FrameSolver::new(body.clone(), levels, limits, &locked, None, settings());
    solver.reset(&body.rest(), &vec![0.0; body.nv]);
    let counts = (0..400).map(|t| {
        let (far, phase) = (t / 50 % 2 == 1, 0.1 * f64::from(t));
        let mut values = fixed.to_vec();
        for side in [1.0, -1.0] {
            let reach = if far { 1.5 } else { 0.2 };
            values.push(vec![reach * phase.cos().abs(), side * (0.3 + 0.1 * phase.sin()), 0.8 + reach * phase.sin()]);
        }
        values.push(body.rest());
        let row = targets(&solver, &values);
        counted(|| solver.frame(&row, 1.0, DT))
    });
    let counts = counts.collect();
    (solver, counts)
}

fn assert_none_but_in_the_first(counts: &[u64], what: &str) {
    assert!(counts[0] > 0, "{what}: the first frame makes its buffers");
    let frames: Vec<usize> = (1..counts.len()).filter(|t| counts[*t] > 0).collect();
    assert!(frames.is_empty(), "{what}: frames {frames:?} allocate");
}

#[test]
fn no_frame_after_the_first_allocates_on_planted_soles() {
    let robot = humanoid();
    let mut pose = robot.body.new_pose();
    robot.body.forward(&robot.body.rest(), &mut pose);
    let (mut soles, mut fixed) = (vec![], vec![]);
    for foot in robot.feet {
        soles.push(task(TaskKind::Position { link: foot, point: [0.0; 3], from: None }, 3));
        soles.push(task(TaskKind::Orientation { link: foot, quat: [1.0, 0.0, 0.0, 0.0] }, 3));
        fixed.extend([pose.position[foot].to_vec(), vec![1.0, 0.0, 0.0, 0.0]]);
    }
    let hands = robot.hands.map(|link| task(TaskKind::Position { link, point: [0.0, 0.0, -0.2], from: None }, 3));
    let support = Task { weight: vec![], ..task(TaskKind::Support { point: None, max_edges: 4, without: vec![] }, 0) };
    let square = [[1.0, 0.0, 0.0, 0.08], [-1.0, 0.0, 0.0, 0.05], [0.0, 1.0, 0.0, 0.1], [0.0, -1.0, 0.0, 0.1]].concat();
    fixed.push(square);
    let levels = vec![soles, vec![support], hands.to_vec(), vec![posture(&robot.body)]];
    let (solver, counts) = run_humanoid(&robot, levels, &fixed);
    assert_none_but_in_the_first(&counts, "soles, support, hands");
    assert!(solver.stats.iterations > 800 && solver.stats.steps > solver.stats.iterations);
    let lowest = solver.task_errors.iter().take(4).fold(0.0, |most: f64, e| most.max(*e));
    assert!(lowest < 1e-3, "the soles are left where they were: {lowest} m or rad off");
}

#[test]
fn no_frame_after_the_first_allocates_where_hands_are_out_of_reach() {
    let robot = humanoid();
    let mut pose = robot.body.new_pose();
    robot.body.forward(&robot.body.rest(), &mut pose);
    robot.body.mass_properties(&mut pose);
    let position = |link: usize| task(TaskKind::Position { link, point: [0.0; 3], from: None }, 3);
    let mut last: Vec<Task> = vec![position(robot.head)];
    last.extend(robot.hands.map(position));
    let levels = vec![
        vec![task(TaskKind::CentreOfMass { over: None }, 3)],
        robot.feet.map(position).to_vec(),
        last,
        vec![posture(&robot.body)],
    ];
    let mut fixed = vec![pose.com.to_vec()];
    fixed.extend(robot.feet.map(|foot| pose.position[foot].to_vec()));
    fixed.push(vec![0.1, 0.0, 1.0]);
    let (solver, counts) = run_humanoid(&robot, levels, &fixed);
    assert_none_but_in_the_first(&counts, "centre of mass, feet, hands");
    assert!(solver.stats.steps > 0 && solver.stats.capped == 0, "{:?}", solver.stats);
}

#[test]
fn no_solve_after_the_first_of_its_size_allocates() {
    let random = &mut Random::new(1);
    let (n, sizes) = (20, [4, 8, 8, 6]);
    let (mut problem, mut stages) = (Problem::new(n, &sizes), Stages::default());
    let mut steps = 0;
    for turn in 0..2000 {
        for r in 0..problem.row_count() {
            // The second level asks for equalities alone, as planted soles do.
            let limit = r < sizes[0] || (r >= sizes[0] + sizes[1] && random.chance(0.5));
            let value = random.normal();
            for i in 0..n {
                problem.row_mut(r)[i] = random.normal();
            }
            problem.present[r] = turn > 0; // the first has nothing to do: buffers are made by size, not by use
            (problem.lower[r], problem.upper[r]) = (value, if limit { f64::INFINITY } else { value });
        }
        for i in 0..n {
            let room = random.between(0.05, 1.0);
            (problem.lo[i], problem.hi[i]) = (-room, room);
        }
        problem.damping = if turn % 3 == 0 { 0.2 } else { 0.0 };
        let mut outcome = Default::default();
        let count = counted(|| outcome = stages.solve(&mut problem, BUDGET));
        assert_eq!(count > 0, turn == 0, "solve {turn}: {count} allocations, {outcome:?}");
        steps += outcome.steps;
    }
    assert!(steps > 20_000, "{steps} steps");
}

fn rod(link: usize, length: f64) -> Observer {
    let shape = Shape::Capsule { half_length: 0.4 * length, radius: 0.02 };
    // Its long axis along the link's x.
    let rotation = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]];
    Observer { link, shape, position: [0.5 * length, 0.0, 0.0], rotation, influence: 0.1, margin: 0.01 }
}

/// A chain of six and five balls beside it; it looks at itself too.
fn among_obstacles() -> (Arc<Body>, Arc<ObserverSet>) {
    let body = chain(6, 0.2);
    let observers = (1..=6).map(|link| rod(link, 0.2)).collect();
    let ball = Shape::Capsule { half_length: 0.0, radius: 0.05 };
    let obstacles = vec![Obstacle { shape: ball, influence: 0.1, margin: 0.01 }; 5];
    let pairs: Vec<_> = (0..6).flat_map(|a| (a + 2..6).map(move |b| (a, b, f64::INFINITY))).collect();
    let around: Vec<_> = (0..5).flat_map(|k| (0..6).map(move |a| (a, k, f64::INFINITY))).collect();
    let set = ObserverSet::new(&body, observers, obstacles, &pairs, &around).unwrap();
    (Arc::new(body), Arc::new(set))
}

fn ball_at(k: usize, shift: f64) -> ObstaclePose {
    let position = [0.5, 0.4 - 0.2 * k as f64 + shift, 0.0];
    ObstaclePose { position, quat: [1.0, 0.0, 0.0, 0.0], linear: [0.03, -0.02, 0.0], angular: [0.0; 3] }
}

fn observers(reactive: bool, speed: f64) -> Task {
    let everyone =
        ObserverTask { reactive, of: vec![true; 6], with_self: true, with_scene: true, speed, ..Default::default() };
    task(TaskKind::Observers(everyone), 0)
}

#[test]
fn no_frame_after_the_first_allocates_among_obstacles() {
    for activation in [Activation::Closest, Activation::All] {
        let (body, set) = among_obstacles();
        let tip = task(TaskKind::Position { link: 6, point: [0.2, 0.0, 0.0], from: None }, 3);
        let levels = vec![vec![observers(true, 0.1)], vec![observers(false, 0.5)], vec![tip], vec![posture(&body)]];
        let limit = Limit { lower: -3.0, upper: 3.0, velocity: 5.0, acceleration: 100.0 };
        let mut solver =
            FrameSolver::new(body.clone(), levels, vec![limit; 6], &[false; 6], Some((set, activation)), settings());
        solver.reset(&[0.3; 6], &[0.0; 6]);
        let mut shift = 0.0;
        let (mut counts, mut both) = (vec![], [0, 0]);
        for t in 0..400 {
            let time = f64::from(t);
            shift += 0.02 * (0.2 * time).sin();
            let monitor = solver.monitor.as_mut().unwrap();
            (0..5).for_each(|k| monitor.set_obstacle(k, ball_at(k, shift), true));
            let goal = vec![0.6 * (0.05 * time).cos(), 0.8 * (0.03 * time).sin(), 0.0];
            let row = targets(&solver, &[vec![], vec![], goal, vec![0.0; 6]]);
            counts.push(counted(|| solver.frame(&row, 1.0, DT)));
            let modes = &solver.monitor.as_ref().unwrap().modes;
            for (count, mode) in both.iter_mut().zip([Mode::Preventive, Mode::Reactive]) {
                *count += modes.iter().filter(|m| **m == mode).count();
            }
        }
        assert_none_but_in_the_first(&counts, &format!("{activation:?}"));
        assert!(both[0] > 100 && both[1] > 0, "{activation:?}: {both:?} frames preventive and reactive");
    }
}

#[test]
fn no_check_of_a_path_allocates_once_it_was_seen() {
    let (body, set) = among_obstacles();
    let columns: Vec<usize> = (0..6).collect();
    let mut checker = PathChecker::new(body, set, &columns, columns.clone(), vec![(1, [0.0; 3])]);
    for (k, obstacle) in checker.scene.obstacles.iter_mut().enumerate() {
        *obstacle = ball_at(k, 0.1);
    }
    let random = &mut Random::new(2);
    let paths: Vec<Vec<f64>> = (0..80)
        .map(|_| {
            let (from, change): (Vec<f64>, Vec<f64>) = (0..6).map(|_| (random.normal(), 0.8 * random.normal())).unzip();
            (0..18)
                .flat_map(|row| (0..6).map(move |k| (row, k)))
                .map(|(row, k)| from[k] + change[k] * row as f64 / 17.0)
                .collect()
        })
        .collect();
    let options = (1.0, false);
    let mut check = |path: &Vec<f64>| checker.is_clear(&path[..6], path, None, DT, options);
    let clear = paths.iter().filter(|path| check(path)).count();
    assert!(clear > 5 && clear < 75, "{clear} of 80 paths are clear");
    let count = counted(|| {
        paths.iter().for_each(|path| {
            black_box(check(path));
        });
    });
    assert_eq!(count, 0);
    let looks = checker.scene.looks;
    assert!(looks > 500, "{looks} postures were looked at");
}

#[test]
fn no_step_of_a_trajectory_allocates() {
    let limits = vec![MotionLimit { velocity: 4.0, acceleration: 40.0, jerk: 400.0 }; 20];
    let mut generator = TrajectoryGenerator::new(limits, DT).unwrap();
    generator.reset(&[0.1; 20], &[0.2; 20], &[0.3; 20]);
    let random = &mut Random::new(3);
    for _ in 0..100 {
        let target: Vec<f64> = (0..20).map(|_| random.normal()).collect();
        assert_eq!(counted(|| generator.step(&target, random.between(0.0, 1.0))), 0);
    }
}
