//! Stress and strain in probes and frames: the requested quantity and its value.

use arlequin_scene::output::{Frames, Pictures};
use arlequin_scene::{Results, RunFolder, Scene, Silent};
use std::path::PathBuf;

const SOLID: &str = "material = { young = 200e9, poisson = 0.25, density = 7800.0 }";

/// Initial displacements `u_x = 1e-4 x` and `u_y = 2e-4 x`.
const STRAIN: &str = "[[initial]]\ndisplacement.polynomial = { component = \"x\", along = \"x\", coefficients = [0.0, 1e-4] }\n\
                      [[initial]]\ndisplacement.polynomial = { component = \"y\", along = \"x\", coefficients = [0.0, 2e-4] }\n\
                      [time]\nsteps = 1\n";

fn halves(right: &str) -> String {
    format!(
        "[model.left]\nkind = \"fem\"\nrole = \"coarse\"\nspacing = 1.0\n{SOLID}\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [6.0, 3.0, 3.0] }}\n\
         [model.right]\n{right}\nrole = \"fine\"\n{SOLID}\n\
         shape.box = {{ low = [3.0, 0.0, 0.0], high = [9.0, 3.0, 3.0] }}\n\
         [interface.joint]\ncoarse = \"left\"\nfine = \"right\"\n\
         overlap.slab = {{ coarse = [3.0, 0.0, 0.0], fine = [6.0, 0.0, 0.0] }}\n"
    )
}

fn probe(name: &str, model: &str, place: &str, quantity: &str, component: &str) -> String {
    let component = if component.is_empty() {
        String::new()
    } else {
        format!("component = \"{component}\"\n")
    };
    format!("[probe.{name}]\nmodel = \"{model}\"\n{place}\nquantity = \"{quantity}\"\n{component}")
}

fn run(text: &str) -> Results {
    let scene = Scene::from_text(text).expect("a scene");
    scene.prepare().expect("built").run(&mut Silent).expect("runs")
}

#[test]
fn both_models_tell_the_stress_of_the_material_in_their_overlap_whatever_their_weights() {
    let (mu, lambda) = (80e9, 80e9);
    let wanted = [
        ("stress", "xx", (lambda + 2.0 * mu) * 1e-4),
        ("stress", "yy", lambda * 1e-4),
        ("stress", "xy", mu * 2e-4),
        ("stress", "yz", 0.0),
        ("strain", "xx", 1e-4),
        ("strain", "xy", 1e-4),
        // 1e-4 (λ + 2μ ± …): deviator 2μ (2/3, −1/3, −1/3, xy = 1) 1e-4.
        ("von-mises", "", 2.0 * mu * 1e-4 * (1.0_f64 + 3.0).sqrt()),
        ("principal-stress", "2", lambda * 1e-4),
        // λ + μ ± √5 μ.
        (
            "principal-stress",
            "1",
            (lambda + mu + mu * 5.0_f64.sqrt()) * 1e-4,
        ),
    ];
    for right in [
        "kind = \"fem\"\nspacing = 0.5\nfem.element = \"tet4\"",
        "kind = \"cnem\"\nspacing = 0.75",
    ] {
        let mut text = halves(right) + STRAIN;
        let places = [
            "at = [4.6, 1.3, 1.1]",
            "at = [3.0, 0.0, 0.0]",
            "where = \"y-max\"",
        ];
        for (k, (quantity, component, _)) in wanted.iter().enumerate() {
            for model in ["left", "right"] {
                for (p, place) in places.iter().enumerate() {
                    text += &probe(&format!("{model}-{k}-{p}"), model, place, quantity, component);
                }
            }
        }
        let results = run(&text);
        for (k, (quantity, component, value)) in wanted.iter().enumerate() {
            for (name, p) in [
                ("left", 0),
                ("left", 1),
                ("left", 2),
                ("right", 0),
                ("right", 1),
                ("right", 2),
            ] {
                let measured = results.probe(&format!("{name}-{k}-{p}")).expect("probe").1[0];
                let scale = if *quantity == "strain" { 1e-4 } else { 1e-4 * mu };
                let error = (measured - value).abs() / scale;
                assert!(
                    error < 1e-9,
                    "{name}, {quantity} {component}, place {p}: {measured:e} for {value:e}"
                );
            }
        }
    }
}

#[test]
fn frames_carry_what_models_recover_and_only_what_is_asked_for() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("stresses-frames");
    let _ = std::fs::remove_dir_all(&folder);
    let grains = "kind = \"dem\"\nspacing = 0.5\ndem.protocol = \"quench\"";
    let fracture = "[[effect]]\nfracture = { criterion = \"rankine\", strength = 1e12 }\n";
    let text = halves(grains) + fracture + STRAIN;
    let head = |scene: &Scene, name: &str, model: &str| {
        let place = folder.join(name);
        let run_folder = RunFolder::new(scene, Some(&place), true).expect("a folder");
        scene
            .prepare()
            .expect("built")
            .run_into(run_folder, &mut Silent)
            .expect("runs");
        let bytes = std::fs::read(place.join(format!("vtu/{model}_00000000.vtu"))).expect("a frame");
        let text = String::from_utf8_lossy(&bytes).into_owned();
        text[..text.find("AppendedData").expect("a head")].to_owned()
    };
    let scene = Scene::from_text(text).expect("a scene");
    let block = head(&scene, "all", "left");
    for array in [
        "stress [Pa]\" NumberOfComponents=\"6\"",
        "strain [-]",
        "von Mises stress [Pa]",
        "principal stresses [Pa]\" NumberOfComponents=\"3\"",
    ] {
        assert!(block.contains(array), "{array} in {block}");
    }
    let spheres = head(&scene, "all", "right");
    for array in [
        "stress [Pa]",
        "axial force [N]",
        "shear force [N]",
        "utilisation [-]",
    ] {
        assert!(spheres.contains(array), "{array} in {spheres}");
    }
    assert!(
        !spheres.contains("strain [-]") && !block.contains("axial"),
        "{spheres}"
    );
    assert!(
        !spheres.contains("contact force"),
        "there is no contact: {spheres}"
    );
    let few = scene.set("output.fields", "['displacement']").expect("fields");
    let bare = head(&few, "few", "right");
    assert!(!bare.contains("[Pa]") && !bare.contains("force"), "{bare}");
}

#[test]
fn frames_have_tensors_in_the_order_and_with_the_shears_that_they_say() {
    let yz = "[[initial]]\ndisplacement.polynomial = { component = \"y\", along = \"z\", coefficients = [0.0, 4e-4] }\n";
    let scene = Scene::from_text(halves("kind = \"fem\"\nspacing = 0.5") + STRAIN + yz).expect("a scene");
    let built = arlequin_scene::setup::build(scene.spec(), scene.folder()).expect("built");
    let pictures = Pictures {
        models: built.models,
        mediators: built.mediators,
        rigid: built.rigid,
    };
    let fields = &scene.spec().output.fields;
    let frames = Frames::new(None, fields, &built.run, pictures);
    let picture = frames
        .picture(&built.run, 0)
        .expect("a picture")
        .expect("a model");
    let (mu, lambda) = (80e9, 80e9);
    let (normal, across) = ((lambda + 2.0 * mu) * 1e-4, lambda * 1e-4);
    for (name, wanted) in [
        ("strain [-]", [1e-4, 0.0, 0.0, 1e-4, 2e-4, 0.0]),
        ("stress [Pa]", [normal, across, across, 2e-4 * mu, 4e-4 * mu, 0.0]),
    ] {
        let array = picture.points.iter().find(|a| a.name == name).expect(name);
        for tensor in array.values.as_chunks::<6>().0 {
            let errors = tensor.iter().zip(wanted).map(|(f, w)| (f - w).abs());
            assert!(
                errors.fold(0.0, f64::max) < 1e-9 * wanted[0],
                "{name}: {tensor:?} for {wanted:?}"
            );
        }
    }
}

#[test]
fn probes_of_stress_refuse_components_and_models_that_have_none() {
    let refused = |addition: &str, key: &str, words: &str| {
        let grains = "kind = \"dem\"\nspacing = 0.5\ndem.protocol = \"quench\"";
        let scene = Scene::from_text(halves(grains) + STRAIN + addition);
        let error = match scene.and_then(|s| s.prepare()) {
            Ok(_) => panic!("taken: {addition}"),
            Err(e) => e,
        };
        assert_eq!(error.place().0, Some(key), "{error}");
        assert!(error.to_string().contains(words), "{error}");
    };
    let place = "at = [1.0, 1.0, 1.0]";
    refused(
        &probe("p", "left", place, "stress", "x"),
        "probe.p.component",
        "\"xx\"",
    );
    refused(
        &probe("p", "left", place, "stress", ""),
        "probe.p.component",
        "is needed",
    );
    refused(
        &probe("p", "left", place, "von-mises", "x"),
        "probe.p.component",
        "remove it",
    );
    refused(
        &probe("p", "left", place, "principal-stress", "xx"),
        "probe.p.component",
        "the largest",
    );
    refused(
        &probe("p", "left", place, "displacement", "xx"),
        "probe.p.component",
        "is no direction",
    );
    refused(
        &probe("p", "left", place, "velocity", ""),
        "probe.p.component",
        "is needed",
    );
    refused(
        &probe("p", "right", "where = \"x-max\"", "strain", "xx"),
        "probe.p.quantity",
        "take \"stress\"",
    );
    let chain = "[model.line]\nkind = \"chain\"\nshape.bar = { from = 20.0, to = 30.0, section = 1.0 }\nspacing = 0.5\n\
                 material = { young = 1.0, density = 1.0 }\n";
    refused(
        &(chain.to_owned() + &probe("p", "line", "where = \"x-max\"", "stress", "xx")),
        "probe.p.quantity",
        "of kind 'chain' knows no stresses",
    );
}

/// Frames show a ball that falls on particles: its surface at its present place, and its contact forces.
#[test]
fn frames_show_rigid_bodies_and_the_forces_of_contact() {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("stresses-rigid");
    let _ = std::fs::remove_dir_all(&folder);
    let text = format!(
        "[model.grains]\nkind = \"dem\"\nspacing = 0.6\ndem.protocol = \"quench\"\n{SOLID}\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [3.0, 3.0, 2.0] }}\n\
         [[effect]]\nobstacle = {{ name = \"my ball\", shape.sphere = {{ centre = [1.5, 1.5, 3.0], radius = 1.0 }}, \
         velocity = [0.0, 0.0, -10.0], mass = 1e8 }}\n\
         [[effect]]\nobstacle = {{ name = \"bed\", shape.plane = {{ point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }} }}\n\
         [[effect]]\nobstacle = {{ name = \"roll\", shape.cylinder = {{ point = [1.5, 0.0, -9.0], axis = [0.0, 1.0, 0.0], radius = 1.0 }} }}\n\
         [time]\nsteps = 100\n[output]\nevery = 100\n"
    );
    let scene = Scene::from_text(text).expect("a scene");
    let run_folder = RunFolder::new(&scene, Some(&folder), true).expect("a folder");
    scene
        .prepare()
        .expect("built")
        .run_into(run_folder, &mut Silent)
        .expect("runs");
    let arrays = |file: &str, name: &str, skip: usize| -> Vec<f64> {
        let bytes = std::fs::read(folder.join("vtu").join(file)).expect("a frame");
        let head = String::from_utf8_lossy(&bytes).into_owned();
        let head_at = head.find(&format!("Name=\"{name}\"")).expect("the array");
        let offset: usize = head[head_at..]
            .split("offset=\"")
            .nth(1)
            .and_then(|s| s.split('"').next())
            .expect("offset")
            .parse()
            .expect("number");
        let mark = b"encoding=\"raw\">\n_";
        let start = bytes.windows(mark.len()).position(|w| w == mark).expect("data") + mark.len() + offset;
        let size = u64::from_le_bytes(bytes[start..start + 8].try_into().expect("eight")) as usize;
        let data = &bytes[start + 8..start + 8 + size];
        let single = head[..head_at].ends_with("type=\"Float32\" ");
        let number = |b: &[u8]| match single {
            true => f64::from(f32::from_le_bytes(b.try_into().expect("four"))),
            false => f64::from_le_bytes(b.try_into().expect("eight")),
        };
        let numbers = data.chunks_exact(if single { 4 } else { 8 });
        numbers.skip(skip).map(number).collect()
    };
    let ball = "rigid-my-ball-grains-0_00000100.vtu";
    let surface = arrays(ball, "position [m]", 0);
    for x in surface.chunks_exact(3) {
        let r = ((x[0] - 1.5).powi(2) + (x[1] - 1.5).powi(2) + (x[2] - 3.0).powi(2)).sqrt();
        assert!((r - 1.0).abs() < 1e-12, "{x:?}");
    }
    let moved = arrays(ball, "displacement [m]", 0);
    assert!(
        moved
            .chunks_exact(3)
            .all(|u| u[2] < -1e-3 && (u[2] - moved[2]).abs() < 1e-15),
        "{:?}",
        &moved[..3]
    );
    let speed = arrays(ball, "velocity [m/s]", 0);
    assert!(speed[2] < -5.0);
    let pushes = arrays("grains_00000100.vtu", "contact force [N]", 0);
    let sum: f64 = pushes.chunks_exact(3).map(|f| f[2]).sum();
    assert!(sum.abs() > 0.0, "the ball pushes");
    for absent in [
        "rigid-bed-grains-1_00000000.vtu",
        "rigid-roll-grains-2_00000000.vtu",
    ] {
        assert!(folder.join("vtu").join(absent).exists(), "{absent}");
    }
    let index = std::fs::read_to_string(folder.join("results.pvd")).expect("an index");
    assert_eq!(index.matches("rigid-my ball-grains").count(), 2, "{index}");
}

/// The mean stress by volume over a whole body of particles is `−1/V Σ x F_int` for any sizes of the spheres,
/// within the digits of the stored stiffnesses of bonds. A mean that counts particles alike would be off by a
/// few per cent.
#[test]
fn the_mean_stress_of_particles_is_that_of_their_volume() {
    let text = format!(
        "[model.grains]\nkind = \"dem\"\nspacing = 0.4\ndem.protocol = \"quench\"\n{SOLID}\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [4.0, 2.0, 2.0] }}\n{STRAIN}"
    ) + &probe(
        "xx",
        "grains",
        "where.box = { low = [-1.0, -1.0, -1.0], high = [9.0, 9.0, 9.0] }",
        "stress",
        "xx",
    ) + &probe(
        "xy",
        "grains",
        "where.box = { low = [-1.0, -1.0, -1.0], high = [9.0, 9.0, 9.0] }",
        "stress",
        "xy",
    );
    let scene = Scene::from_text(text).expect("a scene");
    let mut built = arlequin_scene::setup::build(scene.spec(), scene.folder()).expect("built");
    let s = &built.run.subdomains()[0];
    let mut forces = vec![0.0; s.model().layout().dofs()];
    // F_int = −K q.
    let stiffness = s.model().views().linear.expect("linear").stiffness();
    for (k, (i, j)) in stiffness.iter() {
        forces[i] -= k * s.state().q[j];
    }
    let moment = |a: usize, b: usize| {
        let nodal = s.model().nodes().iter().zip(forces.chunks_exact(3));
        -nodal.map(|(x, f)| x[a] * f[b]).sum::<f64>() / 16.0
    };
    let wanted = [moment(0, 0), 0.5 * (moment(0, 1) + moment(1, 0))];
    for (p, wanted) in built.probes.iter().zip(wanted) {
        let measured = p
            .read(&mut built.run, &mut arlequin_scene::setup::Readings::default())
            .expect("read");
        assert!(
            (measured / wanted - 1.0).abs() < 1e-8,
            "{}: {measured:e} for {wanted:e}",
            p.name
        );
    }
}

/// A probe of stress in the outer layer of particles is warned of, since these spheres have bonds on one side
/// only; a probe inside or of displacements is not.
#[test]
fn a_probe_of_stress_on_the_rim_of_particles_is_warned_of() {
    let place = |low: &str, high: &str| format!("where.box = {{ low = [{low}], high = [{high}] }}");
    let mut text = format!(
        "[model.bar]\nkind = \"dem\"\nspacing = 0.5\ndem.protocol = \"quench\"\n{SOLID}\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [10.0, 4.0, 4.0] }}\n\
         [[support]]\nmodel = \"bar\"\nwhere = \"x-min\"\n\
         [[support]]\nmodel = \"bar\"\nwhere = \"x-max\"\ncomponents = [\"x\", \"y\", \"z\"]\nmotion = {{ amplitude = 1e-4 }}\n[static]\nsteps = 1\n"
    );
    text += &probe("rim", "bar", &place("3, 0, 0", "7, 0.35, 4"), "stress", "xx");
    text += &probe("inner", "bar", &place("3, 1, 1", "7, 3, 3"), "stress", "xx");
    text += &probe("whole", "bar", &place("3, 0, 0", "7, 4, 4"), "stress", "xx");
    text += &probe(
        "moved",
        "bar",
        &place("3, 0, 0", "7, 0.35, 4"),
        "displacement",
        "x",
    );
    text += &probe("skin", "bar", "at = [5.0, 0.25, 2.0]", "stress", "xx");
    text += &probe("core", "bar", "at = [5.0, 2.0, 2.0]", "stress", "xx");
    let prepared = Scene::from_text(text).and_then(|s| s.prepare()).expect("built");
    let warned = |name: &str| {
        let start = format!("probe '{name}': lies on the rim of the particles of 'bar'");
        prepared.warnings().iter().any(|w| w.starts_with(&start))
    };
    let flags = ["rim", "skin", "inner", "core", "whole", "moved"].map(warned);
    assert_eq!(
        flags,
        [true, true, false, false, false, false],
        "{:?}",
        prepared.warnings()
    );
}
