//! One scene with every pair of model kinds, chosen by one word: the interface algorithm is the same.

use crate::common::{arlequin, number, scene, scratch, succeed, summary, text};
use std::path::Path;

/// Coarser meshes and a mediator of tetrahedra where two continua meet, since the intersection of their cells
/// takes time.
const CONTINUA: [&str; 4] = [
    "--set",
    "model.right.spacing=0.3e-3",
    "--set",
    "interface.middle.mediator.element=tet4",
];

/// Returns the header and the rows of a table of results.
fn table(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = std::fs::read_to_string(path).expect("a table");
    let mut lines = text.lines();
    let header = lines
        .next()
        .expect("header")
        .split(',')
        .map(str::to_owned)
        .collect();
    let number = |c: &str| c.parse().expect("number");
    (
        header,
        lines.map(|l| l.split(',').map(number).collect()).collect(),
    )
}

/// Asserts that no tie is redundant, the constraint does no work and leaves no velocity jump, and energy and
/// momenta are conserved.
fn assert_sound(s: &serde_json::Value, out: &Path, kinds: [&str; 2]) {
    let line = &s["interface"][0];
    assert_eq!(line["rank"], line["multipliers"], "{kinds:?}");
    assert!(
        number(s, "/energy/h_drift_max") < 1e-11,
        "{kinds:?}: the ledger closes"
    );
    assert!(number(s, "/energy/ledger/constraint").abs() < 1e-12 * number(s, "/energy/final"));
    assert!(number(s, "/interface/0/max_constraint_residual") < 1e-11);
    assert_momenta_stay(out, kinds);
}

/// Asserts that the blow (100 N, 3 µs, `sin²` over time) gives the two models its impulse along the beam and
/// none across, and that their linear and angular momentum stay constant from its end on.
fn assert_momenta_stay(out: &Path, kinds: [&str; 2]) {
    let (header, rows) = table(&out.join("energy.csv"));
    let first = header
        .iter()
        .position(|h| h.contains("momentum x [kg m/s]"))
        .expect("momentum");
    let free: Vec<&[f64]> = rows
        .iter()
        .filter(|r| r[0] > 3.1e-6)
        .map(|r| &r[first..first + 6])
        .collect();
    assert!(free.len() > 5, "{kinds:?}: {} samples", free.len());
    let impulse = 0.5 * 100.0 * 3e-6;
    let radius = 1e-3;
    let (start, mut change) = (free[0], [0.0f64; 2]);
    for row in &free {
        for k in 0..6 {
            let scale = if k < 3 { impulse } else { impulse * radius };
            change[k / 3] = change[k / 3].max((row[k] - start[k]).abs() / scale);
        }
    }
    assert!(
        change[0] < 1e-12 && change[1] < 1e-12,
        "{kinds:?}: momenta change by {change:?}"
    );
    assert!(
        (start[0] / impulse - 1.0).abs() < 1e-6,
        "{kinds:?}: {} kg m/s",
        start[0]
    );
    let across = start[1].hypot(start[2]);
    assert!(across < 1e-12 * impulse, "{kinds:?}: {across} kg m/s across");
}

/// Returns three velocities: the peak before the overlap, the largest value there after the pulse has passed,
/// and the peak behind the overlap.
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
    assert_sound(&s, &out, kinds);
    let (header, rows) = table(&out.join("probes.csv"));
    let column = |name: &str| header.iter().position(|h| h.starts_with(name)).expect("probe");
    let (before, behind) = (column("before-overlap"), column("behind-overlap"));
    let mut peaks = [0.0f64; 3];
    for row in rows {
        peaks[0] = peaks[0].max(row[before]);
        peaks[2] = peaks[2].max(row[behind]);
        if row[0] > 4.6e-6 {
            peaks[1] = peaks[1].max(row[before].abs());
        }
    }
    peaks
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
        let [incident, reflection, through] = pulse(kinds);
        // A radial oscillation of 1.3 % follows the pulse in one undivided body as well.
        assert!(
            reflection < reflected * incident,
            "{kinds:?}: {:.4} of the amplitude comes back",
            reflection / incident
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
    // With five particles across, the packing is stiffer than the body behind it: a jump of the impedance.
    for fine in ["dem", "fem", "cnem"] {
        let [incident, reflection, through] = pulse(["dem", fine]);
        assert!(
            reflection < 0.1 * incident && (through / incident - 1.0).abs() < 0.1,
            "dem | {fine}: {:.4} of the amplitude comes back, {:.4} goes through",
            reflection / incident,
            through / incident
        );
    }
}

/// The beam of the scene, shorter, with a mediator that both hulls of particle centres have room for.
const SHORT: &str = r#"
[model.left]
kind = "LEFT"
role = "coarse"
shape.cylinder = { from = [0.0, 0.0, 0.0], length = 7e-3, radius = 1e-3 }
spacing = 0.25e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[model.right]
kind = "RIGHT"
role = "fine"
shape.cylinder = { from = [4e-3, 0.0, 0.0], length = 6e-3, radius = 1e-3 }
spacing = 0.2e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }

[interface.middle]
coarse = "left"
fine = "right"
overlap.slab = { coarse = [4e-3, 0.0, 0.0], fine = [7e-3, 0.0, 0.0] }
weight = { profile = "cubic" }
mediator = { spacing = 1.5e-3 }
sampling = "projection"

[[load]]
model = "left"
where = "x-min"
force = [100.0, 0.0, 0.0]
time.pulse = { duration = 3e-6 }

[time]
end = 4e-6

[output]
every = 100000
energy_every = 2
plots = false
"#;

/// The field of natural neighbours between the particles on either side or on both: cells replace points as
/// samples.
#[test]
fn natural_neighbours_between_particles_on_either_side() {
    // Both sides use natural neighbours where both are particles, since points of one are not points of the
    // other.
    for kinds in [
        ["dem", "fem"],
        ["dem", "cnem"],
        ["fem", "dem"],
        ["cnem", "dem"],
        ["dem", "dem"],
    ] {
        let folder = scratch(&format!("natural-{}-{}", kinds[0], kinds[1]));
        let (path, out) = (folder.join("scene.toml"), folder.join("out"));
        let scene = SHORT.replace("LEFT", kinds[0]).replace("RIGHT", kinds[1]);
        std::fs::write(&path, scene).expect("scene");
        let mut arguments = vec!["run", text(&path), "--out", text(&out)];
        let fields = ["model.left.dem.field=natural", "model.right.dem.field=natural"];
        for (kind, field) in kinds.into_iter().zip(fields) {
            if kind == "dem" {
                arguments.extend(["--set", field]);
            }
        }
        succeed(&arguments);
        assert_sound(&summary(&out), &out, kinds);
    }
}

#[test]
fn gradient_junctions_on_particles() {
    let path = scene("dem-fem-beam.toml");
    let check = |settings: &[&str]| {
        let mut arguments = vec!["check", "--json", text(&path)];
        arguments.extend(["--set", "model.right.dem.protocol=quench"]);
        settings.iter().for_each(|m| arguments.extend(["--set", m]));
        let out = arlequin(&arguments);
        let plan: Option<serde_json::Value> = serde_json::from_slice(&out.stdout).ok();
        (plan, String::from_utf8_lossy(&out.stderr).into_owned())
    };
    let condition = |settings: &[&str]| {
        let (plan, message) = check(settings);
        let plan = plan.unwrap_or_else(|| panic!("{settings:?}: {message}"));
        number(&plan, "/interface/0/condition")
    };
    // Gradients fitted to the bonded neighbours, and natural neighbours with a mediator that lies within
    // their hull.
    let h1 = "interface.middle.junction.kind=h1-gradient";
    let natural = [
        "model.right.dem.field=natural",
        "interface.middle.sampling=projection",
    ];
    let values = condition(&[]);
    let [fitted, neighbours] = [&[][..], &natural[..]].map(|fields| {
        let sets: Vec<&str> = [h1].into_iter().chain(fields.iter().copied()).collect();
        let kappa = condition(&sets);
        assert!(kappa > 1.0 && kappa < 1e4, "{fields:?}: {kappa:e}");
        kappa
    });
    // The three operators differ: neither the junction nor the field is ignored.
    for (a, b) in [(values, fitted), (fitted, neighbours), (neighbours, values)] {
        assert!((a / b).ln().abs() > 0.2, "{a:e} {b:e}");
    }
    let (plan, message) = check(&["interface.middle.sampling=intersection"]);
    assert!(
        plan.is_none() && message.contains("use 'particles' sampling"),
        "{message}"
    );
}
