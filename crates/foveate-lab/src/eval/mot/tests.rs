use super::*;
use foveate_base::rng::{Purpose, Streams};
use foveate_core::geometry::BBox;
use rand::RngExt;
use serde_json::Value;
use std::path::Path;

fn at(frame: usize, id: i64, x: f64) -> TrackBox {
    TrackBox { frame, id, bbox: BBox { x, y: 0.0, w: 10.0, h: 10.0 }, confidence: 1.0 }
}
fn tracks(sightings: impl IntoIterator<Item = TrackBox>) -> Tracks {
    Tracks { sightings: sightings.into_iter().collect() }
}
fn near(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-12, "{a} is not {b}");
}

#[test]
fn scores_by_hand() {
    // One target, ten frames; track 1 finds it in frames 0 to 3, none in 4, track 2 in 5 to 9; one box is a false positive.
    let truth = tracks((0..10).map(|t| at(t, 7, t as f64)));
    let found = |t: usize| (t != 4).then(|| at(t, if t < 4 { 1 } else { 2 }, t as f64));
    let results = tracks((0..10).filter_map(found).chain([at(3, 9, 500.0)]));
    let s = score(&truth, &results).expect("a score");
    assert_eq!((s.clear.matches, s.clear.misses, s.clear.false_positives), (9, 1, 1));
    // Frame 4 has no result at all, so it is no gap: fragmentations count frames with boxes in both.
    assert_eq!((s.clear.switches, s.clear.fragmentations, s.clear.mostly_tracked), (1, 0, 1));
    near(s.clear.mota, 0.7);
    near(s.clear.motp, 1.0);
    assert_eq!((s.identity.idtp, s.identity.idfp, s.identity.idfn), (5, 5, 5));
    near(s.identity.idf1, 0.5);
    // DetA 9 / 11; AssA (4 * 4/10 + 5 * 5/10) / 9.
    near(s.hota.det_a, 9.0 / 11.0);
    near(s.hota.ass_a, 4.1 / 9.0);
    near(s.hota.hota, (4.1f64 / 11.0).sqrt());
    near(s.hota.loc_a, 1.0);

    // Half a box to the side: IoU 1/3. No match at 0.5, and one at the six α up to 0.30; AssA is 1 at these.
    let aside = tracks((0..10).map(|t| at(t, 1, t as f64 + 5.0)));
    let s = score(&truth, &aside).expect("a score");
    assert_eq!((s.clear.matches, s.clear.mostly_lost, s.identity.idtp), (0, 1, 0));
    near(s.clear.mota, -1.0);
    near(s.hota.hota, 6.0 / 19.0);
    near(s.hota.alphas[0].loc_a, 1.0 / 3.0);
}

#[test]
fn rows_marked_0_are_not_truth() {
    let ignored = TrackBox { confidence: 0.0, ..at(0, 2, 100.0) };
    let s = score(&tracks([at(0, 1, 0.0), ignored]), &tracks([at(0, 1, 0.0), at(0, 2, 100.0)])).expect("a score");
    assert_eq!((s.truth_boxes, s.truth_ids, s.clear.matches, s.clear.false_positives), (1, 1, 1, 1));
    let nothing = score(&Tracks::default(), &Tracks::default()).expect("a score");
    assert_eq!((nothing.clear.mota, nothing.identity.idf1, nothing.hota.hota), (0.0, 0.0, 0.0));
    let only_found = score(&Tracks::default(), &tracks([at(0, 1, 0.0)])).expect("a score");
    assert_eq!((only_found.clear.mota, only_found.clear.false_positives, only_found.identity.idfp), (0.0, 1, 1));
}

#[test]
fn unscorable_input_is_an_error() {
    let one = tracks([at(0, 1, 0.0)]);
    let said = |truth: &Tracks, results: &Tracks| score(truth, results).expect_err("wrong").to_string();
    assert!(said(&one, &tracks([at(3, 2, 0.0), at(3, 2, 9.0)])).contains("results: id 2 has two boxes in frame 4"));
    assert!(said(&tracks([at(0, -1, 0.0)]), &one).contains("truth: id -1 in frame 1"));
    assert!(said(&one, &tracks((0..4097).map(|id| at(0, id, 0.0)))).contains("4097 boxes in frame 1"));
    let many = |n: i64| tracks((0..n).map(|id| at(id as usize, id, 0.0)));
    assert!(said(&many(10_000), &many(10_000)).contains("too many pairs"));
}

/// 4 random targets in 20 frames, and 5 tracks near them.
fn random(seed: u64) -> (Tracks, Tracks) {
    let mut rng = Streams::new(1, 0).at(seed, Purpose::Scene).rng(0);
    let mut draw = |ids: i64| {
        let all: Vec<(usize, i64)> = (0..20).flat_map(|t| (0..ids).map(move |id| (t, id))).collect();
        let keep = |(t, id): (usize, i64)| {
            let x = id as f64 * 6.0 + rng.random_range(-4.0..4.0);
            (rng.random_range(0.0..1.0) < 0.8).then(|| at(t, id, x))
        };
        tracks(all.into_iter().filter_map(keep))
    };
    (draw(4), draw(5))
}

#[test]
fn scores_keep_to_their_bounds_and_names_do_not_matter() {
    // 200 random videos, seed 1. The properties always hold, so the test cannot fail by chance.
    for seed in 0..200 {
        let (truth, results) = random(seed);
        let s = score(&truth, &results).expect("a score");
        assert_eq!(s.clear.matches + s.clear.misses, s.truth_boxes);
        assert_eq!(s.clear.matches + s.clear.false_positives, s.result_boxes);
        assert_eq!(
            (s.identity.idtp + s.identity.idfn, s.identity.idtp + s.identity.idfp),
            (s.truth_boxes, s.result_boxes)
        );
        assert!(s.clear.mota <= 1.0 && (0.5..=1.0).contains(&s.clear.motp));
        for a in s.hota.alphas {
            let all = [a.hota, a.det_a, a.ass_a, a.ass_re, a.ass_pr, a.loc_a];
            assert!(all.iter().all(|v| (0.0..=1.0 + 1e-12).contains(v)), "{a:?}");
            assert!(a.ass_a <= a.ass_re.min(a.ass_pr) + 1e-12 && a.loc_a >= a.alpha - 1e-12);
            assert!(a.matches * 2 <= s.truth_boxes + s.result_boxes);
        }
        assert!(s.hota.alphas.windows(2).all(|w| w[0].matches >= w[1].matches));
        // Identity and HOTA are symmetric: truth and results may be swapped.
        let turned = score(&results, &truth).expect("a score");
        near(turned.identity.idf1, s.identity.idf1);
        near(turned.hota.loc_a, s.hota.loc_a);
        // Other ids in the same order change nothing; nor does pooling one sequence.
        let rename = |s: &TrackBox| TrackBox { id: 3 * s.id + 11, ..*s };
        assert_eq!(score(&truth, &tracks(results.sightings.iter().map(rename))).expect("a score"), s);
        let pooled = Score::pooled([&s].into_iter());
        near(pooled.hota.hota, s.hota.hota);
        assert_eq!((pooled.clear, pooled.identity), (s.clear.clone(), s.identity.clone()));
        // The truth itself has perfect scores.
        let best = score(&truth, &truth).expect("a score");
        assert_eq!((best.clear.mota, best.identity.idf1, best.clear.switches), (1.0, 1.0, 0));
        near(best.hota.hota, 1.0);
    }
}

/// Compares ours with a peer's scores: integers exactly, the rest to 1e-9.
fn same(ours: &Score, theirs: &Value) {
    let value = serde_json::to_value(ours).expect("numbers");
    for (name, theirs) in theirs.as_object().expect("figures").iter().filter(|(name, _)| *name != "hota_at") {
        let (a, b) = (value[name].as_f64().expect(name), theirs.as_f64().expect(name));
        assert!((a - b).abs() < 1e-9, "{name}: {a} is not {b}");
    }
    for (a, b) in ours.hota.alphas.iter().zip(theirs["hota_at"].as_array().expect("a list")) {
        assert!((a.hota - b.as_f64().expect("a number")).abs() < 1e-9, "{a:?} {b}");
    }
}

#[test]
fn scores_equal_trackeval() {
    let golden: Value = serde_json::from_str(include_str!("../../../tests/data/mot.json")).expect("JSON");
    let mut all = vec![];
    for (name, files) in golden["sequences"].as_object().expect("sequences") {
        let read = |what: &str| Tracks::parse(files[what].as_str().expect("text"), Path::new(what)).expect("tracks");
        let (truth, results) = (read("truth"), read("results"));
        let s = score(&truth, &results).expect("a score");
        same(&s, &golden["expected"][name]);
        // Written tracks are read back with the same scores.
        let again = |t: &Tracks| Tracks::parse(&t.text(), Path::new("own")).expect("own text");
        assert_eq!(score(&again(&truth), &again(&results)).expect("a score"), s);
        all.push(s);
    }
    assert_eq!(all.len(), 3);
    same(&Score::pooled(all.iter()), &golden["expected"]["pooled"]);
}

#[test]
fn sequences_and_results_are_found() {
    let dir = tempfile::tempdir().expect("a temporary folder");
    let write = |path: &str, text: &str| {
        let path = dir.path().join(path);
        std::fs::create_dir_all(path.parent().expect("inside")).expect("a new folder");
        std::fs::write(path, text).expect("written");
    };
    let all = |name: &str| dir.path().join(name);
    for name in ["B", "A"] {
        write(&format!("train/{name}/gt/gt.txt"), "1,1,1,1,9,9,1\n2,1,1,1,9,9,1\n");
    }
    write("train/A/seqinfo.ini", "[Sequence]\nseqLength=3\n");
    write("ours/data/A.txt", "1,5,1,1,9,9,1\n2,5,1,1,9,9,1\n");
    let found = find_sequences(&[all("train")]).expect("two");
    assert_eq!(found.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["A", "B"]);
    let ours = score_results(&found, &all("ours")).expect("one of two");
    assert_eq!(
        (ours.tracker.as_str(), ours.rows[0].score.frames, ours.missing.as_slice()),
        ("ours", 3, &["B".into()][..])
    );
    let text = table::text(std::slice::from_ref(&ours));
    assert!(text.contains("ours has no result for B") && text.contains("pooled, 1"), "{text}");
    let json = table::json(&[ours]);
    assert_eq!(json["trackers"][0]["pooled"]["mota"], 1.0);

    write("ours/B/tracks.txt", "");
    assert_eq!(score_results(&found, &all("ours")).expect("both").pooled().clear.misses, 2);
    let one = find_sequences(&[all("train/A/gt/gt.txt")]).expect("by its file");
    assert_eq!((one[0].name.as_str(), one[0].frames), ("A", Some(3)));
    assert_eq!(score_results(&one, &all("ours/data/A.txt")).expect("a file").rows.len(), 1);

    let said = |e: foveate_base::Error| e.to_string();
    assert!(
        said(score_results(&found, &all("ours/data/A.txt")).expect_err("two")).contains("one file for 2 sequences")
    );
    assert!(said(score_results(&found, &all("train")).expect_err("none")).contains("files such as A.txt"));
    assert!(said(find_sequences(&[all("ours")]).expect_err("none")).contains("no sequence here"));
    write("ours/data/A.txt", "4,5,1,1,9,9,1\n");
    let problem = said(score_results(&one, &all("ours")).expect_err("long"));
    assert!(problem.contains("A.txt: has boxes in frame 4, but seqinfo.ini says 3"), "{problem}");
    write("ours/data/A.txt", "1,5,1,1,9,9,1\n1,5,1,1,9,9,1\n");
    let problem = said(score_results(&one, &all("ours")).expect_err("twice"));
    assert!(problem.contains("A.txt: cannot be scored") && problem.contains("id 5 has two boxes"), "{problem}");
}
