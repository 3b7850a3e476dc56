//! Every pair of model kinds from one scene, by one word: the interface algorithm is the same.

mod common;

use common::{arlequin, number, scene, scratch, succeed, summary, text};

/// Coarser meshes and a mediator of tetrahedra where two continua meet: their cells are intersected, which takes time.
const CONTINUA: [&str; 4] = [
    "--set",
    "model.right.spacing=0.3e-3",
    "--set",
    "interface.middle.mediator.element=tet4",
];

/// Velocity at the two probes: peak before the overlap, largest value there after the pulse has passed, peak behind.
fn pulse(kinds: [&str; 2]) -> [f64; 3] {
    let folder = scratch(&format!("pair-{}-{}", kinds[0], kinds[1]));
    let out = folder.join("out");
    let path = scene("dem-fem-beam.toml");
    let left = format!("model.left.kind={}", kinds[0]);
    let right = format!("model.right.kind={}", kinds[1]);
    let arguments = [
        "run",
        text(&path),
        "--out",
        text(&out),
        "--set",
        &left,
        "--set",
        &right,
    ];
    let mut arguments = arguments.to_vec();
    match kinds {
        [_, "dem"] => {}
        ["dem", _] => arguments.extend(&CONTINUA[..2]),
        _ => arguments.extend(CONTINUA),
    }
    succeed(&arguments);
    let s = summary(&out);
    assert_eq!(
        (s["models"][0]["kind"].as_str(), s["models"][1]["kind"].as_str()),
        (Some(kinds[0]), Some(kinds[1]))
    );
    assert!(
        number(&s, "/energy/h_drift_max") < 1e-11,
        "{kinds:?}: the ledger closes"
    );
    assert!(number(&s, "/energy/ledger/constraint").abs() < 1e-12 * number(&s, "/energy/final"));
    assert!(number(&s, "/interface/0/max_constraint_residual") < 1e-11);
    let table = std::fs::read_to_string(out.join("probes.csv")).expect("probes");
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().expect("header").split(',').collect();
    let column = |name: &str| header.iter().position(|h| h.starts_with(name)).expect("probe");
    let (before, behind) = (column("before-overlap"), column("behind-overlap"));
    let mut found = [0.0f64; 3];
    for line in lines {
        let row: Vec<f64> = line.split(',').map(|c| c.parse().expect("number")).collect();
        found[0] = found[0].max(row[before]);
        found[2] = found[2].max(row[behind]);
        if row[0] > 4.6e-6 {
            found[1] = found[1].max(row[before].abs());
        }
    }
    found
}

#[test]
fn any_pair_by_one_word() {
    for (kinds, reflected) in [
        (["fem", "dem"], 0.02),
        (["fem", "fem"], 0.02),
        (["fem", "cnem"], 0.03),
        (["cnem", "fem"], 0.03),
        (["cnem", "dem"], 0.04),
        (["cnem", "cnem"], 0.04),
    ] {
        let [incident, back, through] = pulse(kinds);
        // A radial oscillation of 1.3 % follows the pulse in one undivided body, too.
        assert!(
            back < reflected * incident,
            "{kinds:?}: {:.4} of the amplitude comes back",
            back / incident
        );
        assert!(
            (through / incident - 1.0).abs() < 0.05,
            "{kinds:?}: {:.4} goes through",
            through / incident
        );
    }
}

#[test]
fn particles_as_the_coarse_model() {
    // Five particles across: their packing is stiffer than what follows, an impedance jump of its own.
    for fine in ["dem", "fem", "cnem"] {
        let [incident, back, through] = pulse(["dem", fine]);
        assert!(
            back < 0.1 * incident && (through / incident - 1.0).abs() < 0.1,
            "dem | {fine}: {:.4} of the amplitude comes back, {:.4} goes through",
            back / incident,
            through / incident
        );
    }
}

/// The field of natural neighbours between the particles, on either side or on both: cells in place of points.
#[test]
fn natural_neighbours_between_particles_on_either_side() {
    let path = scene("dem-fem-beam.toml");
    for kinds in [["dem", "fem"], ["dem", "cnem"], ["fem", "dem"], ["dem", "dem"]] {
        for (k, side) in ["left", "right"]
            .into_iter()
            .enumerate()
            .filter(|(k, _)| kinds[*k] == "dem")
        {
            let field = format!("model.{side}.dem.field=natural");
            let other = if k == 0 { "right" } else { "left" };
            let sets = [
                format!("model.left.kind={}", kinds[0]),
                format!("model.right.kind={}", kinds[1]),
                "model.left.spacing=0.6e-3".into(),
                "model.right.spacing=0.5e-3".into(),
                "interface.middle.mediator.spacing=2e-3".into(),
                "interface.middle.sampling=projection".into(),
                field,
            ];
            let mut arguments = vec!["check", "--json", text(&path)];
            sets.iter().for_each(|s| arguments.extend(["--set", s]));
            // Both as natural neighbours where both are particles: points of one are not points of the other.
            let both = format!("model.{other}.dem.field=natural");
            if kinds == ["dem", "dem"] {
                arguments.extend(["--set", &both]);
            }
            let plan: serde_json::Value = serde_json::from_str(&succeed(&arguments)).expect("a plan");
            let line = &plan["interface"][0];
            assert_eq!(line["rank"], line["multipliers"], "{kinds:?}");
            assert!(number(&plan, "/interface/0/condition") < 1e8, "{kinds:?}: {line}");
        }
    }
}

#[test]
fn gradient_junctions_on_particles() {
    let path = scene("dem-fem-beam.toml");
    let check = |more: &[&str]| {
        let mut arguments = vec!["check", "--json", text(&path)];
        arguments.extend(["--set", "model.right.dem.protocol=quench"]);
        more.iter().for_each(|m| arguments.extend(["--set", m]));
        let out = arlequin(&arguments);
        let plan: Option<serde_json::Value> = serde_json::from_slice(&out.stdout).ok();
        (plan, String::from_utf8_lossy(&out.stderr).into_owned())
    };
    let condition = |more: &[&str]| {
        let (plan, message) = check(more);
        let plan = plan.unwrap_or_else(|| panic!("{more:?}: {message}"));
        number(&plan, "/interface/0/condition")
    };
    // Gradients fitted to the bonded neighbours, and natural neighbours with a mediator drawn into their hull.
    let h1 = "interface.middle.junction.kind=h1-gradient";
    let natural = [
        "model.right.dem.field=natural",
        "interface.middle.sampling=projection",
    ];
    for fields in [&[][..], &natural[..]] {
        let all: Vec<&str> = [h1].into_iter().chain(fields.iter().copied()).collect();
        let found = condition(&all);
        assert!(found > 1.0 && found < 1e6, "{fields:?}: {found:e}");
    }
    let (plan, message) = check(&["interface.middle.sampling=intersection"]);
    assert!(
        plan.is_none() && message.contains("use 'particles' sampling"),
        "{message}"
    );
}
