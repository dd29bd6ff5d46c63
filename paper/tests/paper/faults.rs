//! Every operation on a file fails once, and the program is killed: the next run of an experiment ends as if nothing had been.

use super::job::Job;
use super::place::Place;

/// Two runs on digits drawn by a pen: a table with curves, and the runs that it keeps.
fn reproduce() -> Job {
    let place = Place::new();
    let small = "title = 't'\nabout = 'a'\nseeds = 1\nframes = 12\ndigits = [3]\n\
        scene = [{ name = 'bars', video = { scene = 'occlusion' } }]\n\
        [[line]]\nname = 'Hedge'\nconfig = 'digits-partial'\npolicy = 'hedge'\n\
        [[line]]\nname = 'fixed'\nconfig = 'digits-partial'\npolicy = 'fixed'\n";
    std::fs::write(place.path("small.toml"), small).expect("a writable folder");
    Job::new(place, &["reproduce", "small.toml", "--set", "particles=20", "--out", "out", "--threads", "1"])
}

#[test]
fn each_failure_of_an_experiment_leaves_everything_whole() {
    let job = reproduce();
    let counts = job.fail_each(1);
    assert!(counts.iter().all(|n| *n > 0), "{counts:?}");
    job.kill(2);
}

/// `cargo test -p paper -- --ignored --nocapture`: all failures and a hundred kills.
#[test]
#[ignore = "takes many minutes"]
fn every_failure_and_a_hundred_kills() {
    let job = reproduce();
    println!("failures of open, write, sync, rename: {:?}", job.fail_each(usize::MAX));
    job.kill(100);
}
