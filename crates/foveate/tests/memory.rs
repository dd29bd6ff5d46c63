//! How much memory targets take, by a counting allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use foveate::BBox;
use foveate::config::{Blueprint, Config};
use foveate::files::Nowhere;
use foveate::geometry::Size;
use foveate::scene::Image;

static LIVE: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: every call is handed to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LIVE.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(ptr, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const SIZE: Size = Size::new(640, 480);

fn picture(t: usize) -> Image {
    let Size { width, height } = SIZE;
    let pixel = |k: usize| ((k % width + 2 * t) * 37 % 251 + (k / width) * 91 % 83) as u8;
    Image::new(width, height, 3, (0..3 * width * height).map(|k| pixel(k).wrapping_mul(3)).collect()).expect("whole")
}

/// Where the i-th target is: all over the picture, or each over each.
fn place(i: usize, spread: bool) -> BBox {
    let (x, y) = if spread { ((i * 37 % 610) as f64, (i * 53 % 430) as f64) } else { (300.0, 200.0) };
    BBox::new(x, y, 24.0, 48.0)
}

/// Bytes of `n` targets of 24 × 48 pixels after some frames, those of a template of theirs on average, and the time of a frame; targets
/// that are lost stay.
fn run(config: &str, n: usize, spread: bool, frames: usize) -> (usize, usize, Duration) {
    let mut many = blueprint(config).multi_tracker(1).expect("a configuration of many targets");
    let pictures: Vec<Image> = (0..=frames).map(picture).collect();
    many.update(&pictures[0], &[]).expect("a picture");
    let before = LIVE.load(Ordering::Relaxed);
    for i in 0..n {
        many.add(&pictures[0], None, place(i, spread)).expect("a box");
    }
    let began = Instant::now();
    for picture in &pictures[1..] {
        many.update(picture, &[]).expect("a picture");
    }
    assert!(many.targets().len() == n && !many.is_full());
    let (bytes, time) = (LIVE.load(Ordering::Relaxed) - before, began.elapsed() / frames as u32);
    let saved = if n < 100 { many.save().read().expect("any JSON") } else { serde_json::json!({ "active": [] }) };
    let template = |target: &serde_json::Value| {
        let shape =
            target["ensemble"]["trackers"][0]["appearance"]["template"]["image"][0].as_array().expect("three sides");
        shape.iter().map(|side| side.as_u64().expect("a number") as usize).product()
    };
    let templates: Vec<usize> = saved["active"].as_array().expect("targets").iter().map(template).collect();
    (bytes, templates.iter().sum::<usize>() / templates.len().max(1), time)
}

fn blueprint(config: &str) -> Blueprint {
    let config = Config::builtin(config).expect("it ships").expect("it is right");
    let mut settings = config.multi_target.unwrap_or_default();
    (settings.termination.lost, settings.termination.inside) = (1_000_000, 0.0);
    Config { multi_target: Some(settings), ..config }.check(&Nowhere).expect("parts that fit")
}

/// A target takes the estimated memory beside its template, which is little.
#[test]
fn a_target_takes_the_estimated_memory() {
    for (config, most) in [("multi", 61_000), ("multi-motion", 300_000), ("multi-boxes", 300_000)] {
        let estimate = blueprint(config).memory_of_target() as usize;
        let (more, template, _) = run(config, 60, true, 3);
        let each = (more - run(config, 20, true, 3).0) / 40;
        let beside = each.saturating_sub(template);
        println!("{config}: {each} bytes a target, {template} of them its template; {estimate} estimated");
        let bounds = estimate / 3..=estimate + estimate / 50;
        assert!(estimate <= most && bounds.contains(&beside), "{config}: {beside}, estimate {estimate}, {most}");
    }
}

/// `cargo test --release -p foveate --features lab --test memory -- --ignored --nocapture`
#[test]
#[ignore = "takes minutes"]
fn cost_of_many_targets() {
    println!("| configuration | targets | kB a target | ms a frame | ms a frame, each over each |");
    for config in ["multi", "multi-boxes"] {
        for n in [10, 100, 1000] {
            let ((bytes, _, apart), (_, _, together)) = (run(config, n, true, 3), run(config, n, false, 3));
            let ms = |time: Duration| 1e3 * time.as_secs_f64();
            println!("| `{config}` | {n} | {} | {:.0} | {:.0} |", bytes / n / 1000, ms(apart), ms(together));
        }
    }
    for config in ["multi", "multi-boxes"] {
        let (bytes, _, time) = run(config, 10_000, true, 3);
        println!("10,000 targets of `{config}`: {} MB, {:.1} s a frame", bytes / 1_000_000, time.as_secs_f64());
    }
}
