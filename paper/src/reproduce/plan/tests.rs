use super::*;

#[test]
fn all_experiments_can_be_made() {
    for (name, _) in EXPERIMENTS {
        let experiment = Experiment::named(name).expect(name);
        for line in &experiment.lines {
            let (entry, other) = (line.entry(&[]).expect(name), line.entry(&["particles=77".into()]).expect(name));
            assert!(entry.key != other.key && other.blueprint.config().particles == 77);
        }
        for row in &experiment.paper {
            // The paper's averages are means of its digits, rounded: checks the copying.
            let mean = row.digits.iter().sum::<f64>() / row.digits.len() as f64;
            assert!((mean - row.average).abs() < 0.06, "{name} {}: {mean}", row.row);
            assert!(experiment.lines.iter().any(|l| l.row.as_ref() == Some(&row.row)), "{name} {}", row.row);
        }
    }
    assert!(Experiment::named("table9").is_err_and(|e| e.to_string().contains("table1")));
}

#[test]
fn a_line_takes_what_it_leaves_out_from_the_one_it_is_like() {
    let lines = |second: &str| {
        let text = "title = 't'\nabout = 'a'\nseeds = 1\n[[line]]\nname = 'a'\nconfig = 'digits'\npolicy = 'fixed'\n\
            change = { particles = 7, likelihood = { sharpness = 3 } }\n[[line]]\nname = 'b'\n";
        Experiment::parse("t", &(text.to_owned() + second), "t.toml").map(|e| e.lines)
    };
    let b = &lines("like = 'a'\nchange = { likelihood = { sharpness = 5 } }").expect("two lines")[1];
    let changes = toml::from_str("particles = 7\n[likelihood]\nsharpness = 5").expect("TOML");
    assert_eq!((&b.config[..], b.policy.as_deref(), &b.change), ("digits", Some("fixed"), &changes));
    let b = &lines("like = 'a'\npolicy = 'random'\nconfig = 'digits-hedge'").expect("two lines")[1];
    assert_eq!((&b.config[..], b.policy.as_deref()), ("digits-hedge", Some("random")));
    for (second, said) in [("like = 'c'", "is like c"), ("like = 'b'", "not a line before it"), ("", "`config`")] {
        assert!(lines(second).is_err_and(|e| e.to_string().contains(said)), "{second}");
    }
}

#[test]
fn what_would_be_put_in_or_mixed_up_is_refused() {
    let parse = |more: &str| {
        let text = "title = 't'\nabout = 'a'\nseeds = 1\n[[line]]\nname = 'a'\nconfig = 'digits'\n[[scene]]\nname = 's'\nvideo = \
            { scene = 'clutter', noise = 0.3 }\n";
        Experiment::parse("t", &(text.to_owned() + more), "t.toml")
    };
    parse("").expect("a line and a scene");
    for (more, said) in [
        ("[[scene]]\nname = 'b'\nvideo = { scene = 'clutter', frames = 30 }", "scene b: video.frames is put in"),
        ("[[scene]]\nname = 'b'\nvideo = { scene = 'occlusion', digit = 5 }", "scene b: video.digit is put in"),
        ("[multi]\nname = 'm'\nvideo = { seed = 5 }", "scene m: video.seed is put in"),
        ("[[scene]]\nname = 's'\nvideo = { scene = 'occlusion' }", "two scenes are called s"),
        ("[[line]]\nname = 'a'\nconfig = 'digits-rbm'", "two lines are called a"),
        ("[[expect]]\nline = 'a'\nscene = 't'\nfigure = 'mean'\nat_most = 1", "a figure of a scene t is expected"),
    ] {
        assert!(parse(more).is_err_and(|e| e.to_string().contains(said)), "{more}");
    }
}

#[test]
fn lines_are_compared_with_the_fixed_centre() {
    let table = Experiment::named("table3").expect("it is there");
    let other = |name: &str| {
        let line = table.lines.iter().position(|l| l.name == name).expect(name);
        table.against(line).map(|i| table.lines[i].name.as_str())
    };
    assert_eq!(other("GP-UCB"), Some("fixed centre"));
    assert_eq!(other("EXP3, as printed"), Some("fixed centre, as printed"));
    assert_eq!(other("fixed centre"), None);
}
