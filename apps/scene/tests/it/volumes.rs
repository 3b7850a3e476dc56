//! Mesh files with several volumes: materials, choice of one volume, units.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use arlequin::core::Uniform;
use arlequin_scene::setup::{Built, build};
use arlequin_scene::{Error, RunFolder, Scene, Silent, Source};

/// Two bricks of one metre in a row, `soft` and `stiff`.
const BRICKS: &str = "[model.bar]\nkind = \"fem\"\nshape.file = \"bricks.msh\"\n\
                      material = { young = 1.0, poisson = 0.0, density = 1.0 }\n\
                      materials.stiff = { young = 4.0, density = 3.0 }\n[time]\nsteps = 1\n";

fn scene(text: &str) -> Result<Scene, Error> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/meshes/scene.toml");
    Scene::from_source(Source::new(path, text))
}

fn built(text: &str) -> Built {
    let scene = scene(text).unwrap_or_else(|e| panic!("{e}\n{text}"));
    build(scene.spec(), scene.folder()).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

/// Returns the mass of the nodes below x = 1 m and from there on \[kg\].
fn masses(built: &Built) -> [f64; 2] {
    let model = built.run.subdomains()[0].model();
    let mut inertia = vec![0.0; model.layout().dofs()];
    model.lumped_inertia(&Uniform(1.0), &mut inertia).unwrap();
    let mut out = [0.0; 2];
    for (x, m) in model.nodes().iter().zip(inertia.as_chunks::<3>().0) {
        out[usize::from(x.x >= 1.0)] += m[0];
    }
    out
}

#[test]
fn volumes_in_a_row_stretch_by_their_own_moduli() {
    let pull = "[[support]]\nmodel = \"bar\"\nwhere = \"left\"\n\
                [[load]]\nmodel = \"bar\"\nwhere = \"right\"\ntraction = [0.01, 0.0, 0.0]\ntime = \"step\"\n";
    let mut bar = built(&format!("{BRICKS}{pull}"));
    let solved = bar.run.equilibrium(1.0).unwrap();
    let nodes = bar.run.subdomains()[0].model().nodes();
    for (x, u) in nodes.iter().zip(solved.displacements[0].as_chunks::<3>().0) {
        let wanted = 0.01 * (x.x.min(1.0) + (x.x - 1.0).max(0.0) / 4.0);
        assert!(
            (u[0] - wanted).abs() < 1e-12 && u[1].abs() < 1e-12 && u[2].abs() < 1e-12,
            "{x}: {u:?}"
        );
    }
    assert!((masses(&bar).iter().sum::<f64>() - 4.0).abs() < 1e-12);
    // The stress uses the material of each element: equal in both bricks, where the strain of the stiff one
    // is a quarter.
    let ends: Vec<usize> = (0..nodes.len())
        .filter(|k| [0.0, 2.0].contains(&nodes[*k].x))
        .collect();
    let recovery = bar.run.subdomains()[0].model().views().recovery.unwrap();
    let mut recovered = Vec::new();
    recovery
        .recover(&solved.displacements[0], &ends, &mut recovered)
        .unwrap();
    for (k, r) in ends.iter().zip(&recovered) {
        assert!(
            (r.stress.0[0] - 0.01).abs() < 1e-11,
            "{}: {:?}",
            nodes[*k],
            r.stress
        );
    }
    assert!(bar.warnings.is_empty(), "{:?}", bar.warnings);
    // Without a second material the scene warns that it takes both volumes for one.
    let alike = built(&BRICKS.replace("materials.stiff = { young = 4.0, density = 3.0 }\n", ""));
    assert!(
        alike
            .warnings
            .iter()
            .any(|w| w.contains("has 2 volumes (soft, stiff)")),
        "{:?}",
        alike.warnings
    );
}

/// Energy densities in the frames are `½ σ²/E` with each volume's own modulus, and their sum over the
/// elements is the stored energy.
#[test]
fn energy_densities_are_those_of_the_volumes_own_materials() {
    let pull = "[[support]]\nmodel = \"bar\"\nwhere = \"left\"\n\
                [[load]]\nmodel = \"bar\"\nwhere = \"right\"\ntraction = [0.01, 0.0, 0.0]\ntime = \"step\"\n\
                [static]\nsteps = 1\n";
    let pulled = scene(&(BRICKS.replace("[time]\nsteps = 1\n", "") + pull)).unwrap();
    let folder = std::path::PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("volumes-density");
    let run_folder = RunFolder::new(&pulled, Some(&folder), true).unwrap();
    pulled
        .prepare()
        .unwrap()
        .run_into(run_folder, &mut Silent)
        .unwrap();
    let bytes = std::fs::read(folder.join("vtu/bar_00000001.vtu")).unwrap();
    let head = String::from_utf8_lossy(&bytes).into_owned();
    let head_at = head.find("Name=\"energy density [J/m3]\"").unwrap();
    let offset = head[head_at..]
        .split("offset=\"")
        .nth(1)
        .and_then(|s| s.split('"').next());
    let mark = b"encoding=\"raw\">\n_";
    let start = bytes.windows(mark.len()).position(|w| w == mark).unwrap() + mark.len();
    let start = start + offset.unwrap().parse::<usize>().unwrap();
    let size = u64::from_le_bytes(bytes[start..start + 8].try_into().unwrap()) as usize;
    let data = bytes[start + 8..start + 8 + size].as_chunks::<4>().0;
    let densities: Vec<f64> = data.iter().map(|b| f32::from_le_bytes(*b).into()).collect();
    let [soft, stiff] = [0.5e-4, 0.125e-4];
    let near = |wanted: f64| {
        densities
            .iter()
            .filter(|x| (**x / wanted - 1.0).abs() < 1e-6)
            .count()
    };
    assert_eq!(
        (near(soft) + near(stiff), near(soft)),
        (densities.len(), densities.len() / 2),
        "{densities:?}"
    );
}

#[test]
fn spheres_weigh_what_their_volume_weighs() {
    let spheres = BRICKS.replace(
        "kind = \"fem\"",
        "kind = \"dem\"\nspacing = 0.14\ndem.protocol = \"quench\"",
    );
    let [soft, stiff] = masses(&built(&spheres));
    // A layer of half spheres belongs to the neighbour.
    assert!(
        (soft - 1.0).abs() < 0.1 && (stiff - 3.0).abs() < 0.3,
        "{soft} {stiff}"
    );
}

#[test]
fn one_volume_of_a_file_is_a_body_and_files_have_units() {
    let one_volume = BRICKS.replace(
        "materials.stiff = { young = 4.0, density = 3.0 }",
        "volume = \"stiff\"\nscale = 1e-3",
    );
    let built = built(&one_volume);
    let nodes = built.run.subdomains()[0].model().nodes();
    let ends = nodes
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| {
            [a.min(x.x), b.max(x.x)]
        });
    assert!(
        (ends[0] - 1e-3).abs() < 1e-15 && (ends[1] - 2e-3).abs() < 1e-15,
        "{ends:?}"
    );
    assert!((masses(&built).iter().sum::<f64>() - 1e-9).abs() < 1e-20);
    let spheres = one_volume.replace(
        "kind = \"fem\"",
        "kind = \"dem\"\nspacing = 0.16e-3\ndem.protocol = \"quench\"",
    );
    let built = self::built(&spheres);
    let nodes = built.run.subdomains()[0].model().nodes();
    assert!(
        nodes
            .iter()
            .all(|x| (1e-3..2e-3).contains(&x.x) && (0.0..1e-3).contains(&x.y))
    );
}

#[test]
fn elements_of_second_order_are_told_of() {
    let built = built(&BRICKS.replace("bricks.msh", "bricks-second-order.msh"));
    assert!(
        built
            .warnings
            .iter()
            .any(|w| w.contains("elements of second order are read as linear ones")),
        "{:?}",
        built.warnings
    );
}

#[test]
fn volumes_and_materials_that_are_not_there_are_refused() {
    let brittle = "[[effect]]\nfracture = { criterion = \"axial\", strength = 1.0 }\n";
    for (from, to, key, words) in [
        (
            "materials.stiff",
            "materials.steel",
            "model.bar.materials",
            "known: soft, stiff",
        ),
        (
            "materials.stiff",
            "volume = \"steel\"\nmaterials.stiff",
            "model.bar.volume",
            "known: soft, stiff",
        ),
        (
            "young = 4.0",
            "young = -4.0",
            "model.bar.materials.stiff.young",
            "must be positive",
        ),
        (
            "young = 4.0,",
            "young = 4.0, poisson = 0.7,",
            "model.bar.materials.stiff.poisson",
            "below 0.5",
        ),
        (
            "kind = \"fem\"",
            "kind = \"cnem\"",
            "model.bar.materials",
            "take kind = \"fem\"",
        ),
        (
            "kind = \"fem\"",
            "kind = \"fem\"\nscale = -1.0",
            "model.bar.scale",
            "must be positive",
        ),
        ("[time]", &format!("{brittle}[time]"), "", ""),
    ] {
        let mut text = BRICKS.replacen(from, to, 1);
        let mut wanted = (key, words);
        if key.is_empty() {
            text = text.replace(
                "kind = \"fem\"",
                "kind = \"dem\"\nspacing = 0.2\ndem.protocol = \"quench\"",
            );
            wanted = ("effect[0].fracture", "give the model one material");
        }
        let prepared = scene(&text).and_then(|s| s.prepare());
        let e = prepared.err().unwrap_or_else(|| panic!("taken: {text}"));
        assert_eq!(e.place().0, Some(wanted.0), "{e}");
        assert!(e.to_string().contains(wanted.1), "{e}");
    }
}

/// Two bricks that differ only in their materials: the viscosity uses `√(E ρ)` of each, and a wave has the
/// speed `√(E/ρ)` of each.
#[test]
fn viscosity_and_waves_know_what_each_volume_is_made_of() {
    let stiff = "materials.stiff = { young = 4.0, density = 3.0 }\n";
    let power = |text: &str| {
        let stretch = "[[initial]]\nvelocity.polynomial = { component = \"x\", along = \"x\", coefficients = [0.0, 1e-3] }\n\
                       [[effect]]\nbulk_viscosity = {}\n";
        let mut bar = built(&(text.replace("steps = 1\n", "steps = 1\nstep.seconds = 1e-9\n") + stretch));
        bar.run.run(1, &mut arlequin::core::Silent).unwrap();
        let works = bar.run.works();
        works.iter().find(|w| w.name.contains("viscosity")).unwrap().work
    };
    let ratio = power(BRICKS) / power(&BRICKS.replace(stiff, ""));
    let wanted = f64::midpoint(1.0, 12.0_f64.sqrt());
    assert!((ratio / wanted - 1.0).abs() < 1e-6, "{ratio} for {wanted}");
    let wave = "[[initial]]\nwave = { component = \"x\", along = \"x\", centre = 1.0, width = 8.0, amplitude = 1e-3 }\n";
    let bar = built(&format!("{BRICKS}{wave}"));
    let s = &bar.run.subdomains()[0];
    let slope =
        |x: f64| -1e-3 * std::f64::consts::PI / 8.0 * (2.0 * std::f64::consts::PI * (x - 1.0) / 8.0).sin();
    for (x, v) in s.model().nodes().iter().zip(s.state().v.as_chunks::<3>().0) {
        let speed = if x.x < 1.0 - 1e-9 {
            1.0
        } else {
            (4.0_f64 / 3.0).sqrt()
        };
        assert!((v[0] + speed * slope(x.x)).abs() < 1e-15, "{x}: {v:?}");
    }
}

/// Spheres fill a file in millimetres at the size that `scale` gives.
#[test]
fn spheres_fill_files_at_their_scale() {
    let folder = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join("volumes-scale");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::copy(
        concat!(env!("CARGO_MANIFEST_DIR"), "/tests/meshes/bricks.msh"),
        folder.join("bricks.msh"),
    )
    .unwrap();
    // A block of 2 by 1 by 1.
    let corner = |k: usize| format!("vertex {} {} {}\n", 2 * (k & 1), k >> 1 & 1, k >> 2);
    let faces = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let facet = |t: [usize; 3]| {
        format!(
            "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n",
            t.map(corner).concat()
        )
    };
    let facets = faces.map(|[a, b, c, d]| facet([a, b, c]) + &facet([a, c, d]));
    std::fs::write(
        folder.join("bricks.stl"),
        format!("solid b\n{}endsolid b\n", facets.concat()),
    )
    .unwrap();
    for file in ["bricks.msh", "bricks.stl"] {
        let text = format!(
            "[model.bar]\nkind = \"dem\"\nshape.file = \"{file}\"\nscale = 1e-3\nspacing = 0.2e-3\ndem.protocol = \"quench\"\n\
             material = {{ young = 1e9, poisson = 0.2, density = 1000.0 }}\n[time]\nsteps = 1\n"
        );
        let scene = Scene::from_source(Source::new(folder.join("scene.toml"), text)).unwrap();
        let bar = build(scene.spec(), scene.folder()).unwrap_or_else(|e| panic!("{file}: {e}"));
        let mass: f64 = masses(&bar).iter().sum();
        assert!((mass / 2e-6 - 1.0).abs() < 1e-9, "{file}: {mass:e} kg");
        let nodes = bar.run.subdomains()[0].model().nodes();
        assert!(
            nodes.iter().all(|x| x.x > 0.0 && x.x < 2e-3 && x.z < 1e-3),
            "{file}"
        );
    }
}
