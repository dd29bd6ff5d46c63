//! The functions of `fuzz/src/bodies.rs` over the stored corpus, in every run of the tests; and over mutations of it, for as long as one
//! likes: `fuzz/run`.

#[path = "../../../fuzz/src/bodies.rs"]
mod bodies;
#[path = "../src/cmd/serve/http.rs"]
#[allow(dead_code)]
mod http;
#[path = "../src/cmd/trax/message.rs"]
#[allow(dead_code)]
mod message;
#[path = "fuzz/mutate.rs"]
mod mutate;
#[path = "fuzz/numbers.rs"]
mod numbers;

use std::alloc::{GlobalAlloc, Layout, System};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use mutate::Mutator;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

struct Counting;

// SAFETY: every call is handed to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(live, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, ptr: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(ptr, layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(live, Ordering::Relaxed);
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// What takes less than this needs no closer look.
const CERTAIN: Duration = Duration::from_millis(100);
/// Bytes that an execution may take, and the limit that it is given.
const MOST: usize = 300 << 20;
const LIMIT: u64 = 200 << 20;

fn corpus(name: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus").join(name);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    files.sort();
    files.into_iter().map(|path| (path.clone(), std::fs::read(path).expect("a file"))).collect()
}

/// How long an execution took, and how much memory; nothing where it panicked.
fn execute(body: fn(&[u8]), bytes: &[u8]) -> Option<(Duration, usize)> {
    let before = LIVE.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let (began, worked) = (Instant::now(), worked());
    std::panic::catch_unwind(|| body(bytes)).ok()?;
    let took = began.elapsed();
    // On a busy machine most of a long time is waiting for a processor.
    let took = if took < CERTAIN {
        took
    } else {
        worked.and_then(|before| self::worked()?.checked_sub(before)).unwrap_or(took)
    };
    Some((took, PEAK.load(Ordering::Relaxed).saturating_sub(before)))
}

/// Time that this process has had processors for, in hundredths of a second; `None` where the system does not report it.
fn worked() -> Option<Duration> {
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<u64>().ok();
    Some(Duration::from_millis(10 * (ticks()? + ticks()?)))
}

#[test]
fn the_corpus_is_taken_without_a_panic() {
    foveate::memory::set_limit(LIMIT);
    for (name, body, longest) in bodies::ALL {
        let inputs = corpus(name);
        assert!(!inputs.is_empty(), "{name} has no corpus");
        for (path, bytes) in inputs {
            assert!(bytes.len() <= longest, "{} would always be cut off", path.display());
            let (_, memory) = execute(body, &bytes).unwrap_or_else(|| panic!("{} panics", path.display()));
            assert!(memory < MOST, "{} takes {memory} bytes", path.display());
            // And cut off anywhere, at up to 16 places.
            for k in 1..16 {
                assert!(execute(body, &bytes[..bytes.len() * k / 16]).is_some(), "{} cut off panics", path.display());
            }
        }
    }
}

/// Inputs that no reader accepts do not test the code after reading.
#[test]
fn the_states_of_the_corpus_are_states() {
    let ours = ["many.json", "tracker.json"].map(std::ffi::OsStr::new);
    for (path, bytes) in corpus("states").iter().filter(|(path, _)| path.file_name().is_some_and(|n| ours.contains(&n)))
    {
        assert!(
            bodies::goes_on(bytes),
            "{}: cargo test -p foveate-cli --test fuzz -- --ignored write_states",
            path.display()
        );
    }
    let many = bodies::saved()[1].1.clone();
    assert!(String::from_utf8(many).expect("JSON").contains("\"waiting\":{"), "a target waits for a look");
}

/// One number of a state is another: it is refused, or the tracker continues. An eighth of all numbers and values; the step of 8 and nine values
/// meet every number.
#[test]
fn states_with_a_number_that_cannot_be_do_not_panic() {
    foveate::memory::set_limit(LIMIT);
    for (path, bytes) in corpus("states") {
        let Ok(state) = serde_json::from_slice::<serde_json::Value>(&bytes) else { continue };
        let mut places = vec![];
        numbers::places(&state, "", &mut places);
        let all = places.iter().flat_map(|place| numbers::odd().map(|odd| (place, odd)));
        for (place, odd) in all.step_by(8) {
            let mut other = state.clone();
            *other.pointer_mut(place).expect("it was found there") = odd.clone();
            let bytes = serde_json::to_vec(&other).expect("JSON");
            let (_, memory) = execute(bodies::states, &bytes)
                .unwrap_or_else(|| panic!("{} panics with {odd} at {place}", path.display()));
            assert!(memory < MOST, "{} takes {memory} bytes with {odd} at {place}", path.display());
        }
    }
}

/// Writes the states of the corpus anew, after a change of their format.
#[test]
#[ignore = "writes into the tree"]
fn write_states() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus/states");
    std::fs::create_dir_all(&folder).expect("a writable tree");
    bodies::saved().into_iter().for_each(|(name, bytes)| std::fs::write(folder.join(name), bytes).expect("written"));
}

/// `FOVEATE_FUZZ=NAME:COUNT[:SEED]`, separated by commas; `all` is every name. A line each: executions, panics, the longest, the most memory.
/// What panics is kept in `fuzz/crashes/NAME`.
#[test]
#[ignore = "as long as one likes: see fuzz/run"]
fn mutations() {
    foveate::memory::set_limit(LIMIT);
    let asked = std::env::var("FOVEATE_FUZZ").unwrap_or("all:1000".into());
    let mut panicked = 0;
    for one in asked.split(',') {
        let mut parts = one.split(':');
        let name = parts.next().unwrap_or_default();
        let mut number = |usual: u64| parts.next().and_then(|n| n.parse().ok()).unwrap_or(usual);
        let (count, seed) = (number(1000), number(1));
        for (name, body, longest) in bodies::ALL.into_iter().filter(|(n, ..)| name == "all" || *n == name) {
            panicked += fuzz(name, body, longest, count, seed);
        }
    }
    assert_eq!(panicked, 0, "some panicked: see fuzz/crashes");
}

/// What `mutations` kept in `fuzz/crashes`, again: for whoever mends it.
#[test]
#[ignore = "as many as there are: see fuzz/run"]
fn kept() {
    foveate::memory::set_limit(LIMIT);
    for (name, body, _) in bodies::ALL {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/crashes").join(name);
        for path in std::fs::read_dir(folder).into_iter().flatten().map(|entry| entry.expect("an entry").path()) {
            match execute(body, &std::fs::read(&path).expect("a file")) {
                Some((time, memory)) => println!("| {} | {time:.0?} | {} MiB |", path.display(), memory >> 20),
                None => println!("| {} | panics | |", path.display()),
            }
        }
    }
}

fn fuzz(name: &str, body: fn(&[u8]), longest: usize, count: u64, seed: u64) -> usize {
    let corpus: Vec<Vec<u8>> = corpus(name).into_iter().map(|(_, bytes)| bytes).collect();
    assert!(corpus.iter().all(|bytes| bytes.len() <= longest), "{name}: a file of the corpus would always be cut off");
    let mut mutator = Mutator::new(seed);
    let (mut slowest, mut most, mut panics) = (Duration::ZERO, 0, 0);
    let crashes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/crashes").join(name);
    let began = Instant::now();
    for k in 0..count {
        let bytes = mutator.next(&corpus, longest);
        let keep = |why: &str| {
            std::fs::create_dir_all(&crashes).expect("a folder for crashes");
            std::fs::write(crashes.join(format!("{why}-{seed}-{k}")), &bytes).expect("room for a small file");
        };
        match execute(body, &bytes) {
            Some((time, memory)) => {
                if time > Duration::from_secs(1) {
                    keep("slow");
                }
                if memory > MOST {
                    keep("large");
                }
                (slowest, most) = (slowest.max(time), most.max(memory));
            }
            None => {
                keep("panic");
                panics += 1;
            }
        }
    }
    println!(
        "| {name} | {count} | {panics} | {:.0} ms | {} MiB | {:.0} s |",
        1e3 * slowest.as_secs_f64(),
        most >> 20,
        began.elapsed().as_secs_f64()
    );
    panics
}
