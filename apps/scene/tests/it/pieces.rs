//! Frames in pieces: the pieces of all ranks together are the frame that one rank writes, bit for bit, also
//! over earlier pieces in the folder.
#![allow(clippy::print_stdout, reason = "a test says what it could not run")]

use arlequin::core::Coupled;
use arlequin_mpi::threads;
use arlequin_scene::{End, Error, Observer, Result, Results, RunFolder, Scene, Silent, resume_on};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;

const WAIT: Duration = Duration::from_secs(60);

/// Spheres that are torn apart and struck by a ball, tied to elements (two units: partitioned on two ranks,
/// whole on more), and natural elements beside them.
const BODIES: &str = r#"
[model.bar]
kind = "dem"
role = "fine"
shape.box = { low = [0.0, 0.0, 0.0], high = [8e-3, 2e-3, 2e-3] }
spacing = 0.3e-3
dem.protocol = "quench"
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[model.grip]
kind = "fem"
role = "coarse"
shape.box = { low = [-4e-3, 0.0, 0.0], high = [1.5e-3, 2e-3, 2e-3] }
spacing = 0.5e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[model.gum]
kind = "cnem"
shape.box = { low = [0.0, 5e-3, 0.0], high = [6e-3, 7e-3, 2e-3] }
spacing = 0.35e-3
material = { young = 75e9, poisson = 0.17, density = 2200.0 }
[interface.rim]
coarse = "grip"
fine = "bar"
overlap.slab = { coarse = [0.0, 0.0, 0.0], fine = [1.5e-3, 0.0, 0.0] }
mediator = { spacing = 0.75e-3 }
[[effect]]
models = ["bar"]
fracture = { criterion = "rankine", strength = 100e6, weibull = 10.0 }
[[effect]]
models = ["bar"]
contact = { friction = 0.3 }
[[effect]]
models = ["bar"]
[effect.obstacle]
name = "ball"
shape.sphere = { centre = [6e-3, 1e-3, 3.002e-3], radius = 1e-3 }
mass = 2e-5
velocity = [2.0, 0.0, -40.0]
contact = { friction = 0.3 }
[[initial]]
models = ["bar", "gum"]
velocity.polynomial = { component = "x", along = "x", coefficients = [-3.0, 2000.0] }
[time]
end = 1.5e-6
[probe.end]
model = "bar"
where = "x-max"
quantity = "velocity"
component = "x"
[output]
interval = 0.5e-6
energy_every = 5
plots = false
"#;

fn scratch(name: &str) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("pieces-{name}"));
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder");
    folder
}

fn scene(pieces: bool) -> Scene {
    let scene = Scene::from_text(BODIES).expect("a scene");
    scene
        .set("output.pieces", if pieces { "true" } else { "false" })
        .expect("a key")
}

fn run(scene: &Scene, folder: &Path, observer: &mut dyn Observer) -> Result<Results> {
    let run_folder = RunFolder::new(scene, Some(folder), true)?;
    scene.prepare()?.run_into(run_folder, observer)
}

/// Returns the folder of a run of one rank without pieces, and its number of frames.
fn single_rank_run() -> (&'static Path, usize) {
    static ONE: OnceLock<(PathBuf, usize)> = OnceLock::new();
    let make_run = || {
        let folder = scratch("one").join("out");
        let done = run(&scene(false), &folder, &mut Silent).expect("runs");
        (folder, done.summary().frames)
    };
    let (folder, frames) = ONE.get_or_init(make_run);
    (folder, *frames)
}

fn on_ranks(ranks: usize, folder: &Path) -> Vec<Result<Results>> {
    let scene = scene(true);
    let per_rank = threads::run(ranks, 1, WAIT, |c| {
        run(&scene.clone().on_ranks(c)?, folder, &mut Silent)
    });
    per_rank
        .into_iter()
        .map(|r| r.expect("no rank is lost"))
        .collect()
}

/// Returns the value of an XML attribute.
fn word<'a>(line: &'a str, key: &str) -> &'a str {
    let start = line.find(&format!("{key}=\"")).expect("a key") + key.len() + 2;
    let tail = &line[start..];
    &tail[..tail.find('"').expect("an end")]
}

/// Arrays of a VTU file by section and name: type, components, bytes.
type Arrays = BTreeMap<String, (String, usize, Vec<u8>)>;

fn arrays(path: &Path) -> Arrays {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let head = b"<AppendedData encoding=\"raw\">\n_";
    let start = bytes.windows(head.len()).position(|w| w == head).expect("data") + head.len();
    let text = std::str::from_utf8(&bytes[..start]).expect("a head");
    let mut section = String::new();
    let mut out = Arrays::new();
    for line in text.lines().map(str::trim) {
        if line.starts_with("<DataArray") {
            let data_start = start + word(line, "offset").parse::<usize>().expect("a number");
            let size =
                u64::from_le_bytes(bytes[data_start..data_start + 8].try_into().expect("8 bytes")) as usize;
            let components = word(line, "NumberOfComponents").parse().expect("a number");
            let array = (
                word(line, "type").to_owned(),
                components,
                bytes[data_start + 8..data_start + 8 + size].to_vec(),
            );
            out.insert(format!("{section}/{}", word(line, "Name")), array);
        } else if let Some(name) = line.strip_prefix('<') {
            let end = name.find([' ', '>']).expect("an end");
            section = name[..end].to_owned();
        }
    }
    out
}

/// Bytes of a number.
fn size_of(kind: &str) -> usize {
    match kind {
        "UInt8" => 1,
        "Int32" | "Float32" => 4,
        "Int64" | "Float64" => 8,
        other => panic!("numbers of kind {other}"),
    }
}

fn integers(frame: &Arrays, name: &str) -> Vec<usize> {
    let (kind, _, bytes) = frame
        .get(name)
        .unwrap_or_else(|| panic!("{name} in {:?}", frame.keys()));
    let to_number = |b: &[u8]| {
        let n = match kind.as_str() {
            "Int32" => i32::from_le_bytes(b.try_into().expect("four bytes")).into(),
            _ => i64::from_le_bytes(b.try_into().expect("eight bytes")),
        };
        usize::try_from(n).expect("a number")
    };
    bytes.chunks_exact(size_of(kind)).map(to_number).collect()
}

/// Returns the frame that the pieces make, and the number of ghosts. Asserts that every ghost equals its
/// owned node.
fn join_pieces(parallel: &Path, pieces: usize) -> (Arrays, usize) {
    let text = std::fs::read_to_string(parallel).expect("a file");
    let lines = || text.lines().map(str::trim);
    let files = lines()
        .filter(|l| l.starts_with("<Piece"))
        .map(|l| word(l, "Source"));
    let raw: Vec<Arrays> = files.map(|f| arrays(&parallel.with_file_name(f))).collect();
    assert_eq!(raw.len(), pieces);
    // The parallel file declares the arrays that the pieces have.
    let declared = lines().filter(|l| l.starts_with("<PDataArray"));
    let mut declared: Vec<_> = declared.map(|l| (word(l, "Name"), word(l, "type"))).collect();
    declared.sort_unstable();
    let name = |k: &'_ str| k.split_once('/').expect("a section").1.to_owned();
    for piece in &raw {
        let held = piece.iter().filter(|(k, _)| !k.starts_with("Cells/"));
        let mut held: Vec<_> = held.map(|(k, a)| (name(k), a.0.clone())).collect();
        held.sort_unstable();
        assert!(
            held.iter()
                .map(|h| (h.0.as_str(), h.1.as_str()))
                .eq(declared.iter().copied()),
            "{held:?} {declared:?}"
        );
    }
    let numbers: Vec<_> = raw
        .iter()
        .map(|p| integers(p, "PointData/GlobalPointIds"))
        .collect();
    let cells: Vec<_> = raw
        .iter()
        .map(|p| integers(p, "CellData/GlobalCellIds"))
        .collect();
    let ghosts: Vec<_> = raw
        .iter()
        .map(|p| p["PointData/vtkGhostType"].2.clone())
        .collect();
    let counts = [
        ghosts.iter().flatten().filter(|g| **g == 0).count(),
        cells.iter().map(Vec::len).sum(),
    ];
    let mut out = Arrays::new();
    for (key, (kind, width, _)) in &raw[0] {
        let (section, name) = key.split_once('/').expect("a section");
        if ["GlobalPointIds", "GlobalCellIds", "vtkGhostType"].contains(&name) {
            continue;
        }
        let of_cells = ["CellData", "Cells"].contains(&section);
        let corners = raw.iter().map(|p| p["Cells/types"].2.len()).sum::<usize>();
        let bytes = width * size_of(kind);
        let width = match name {
            "connectivity" => raw.iter().map(|p| p[key].2.len()).sum::<usize>() / corners.max(1),
            _ => bytes,
        };
        let count = counts[usize::from(of_cells)];
        let mut whole: Vec<Option<&[u8]>> = vec![None; count];
        let mut mapped = Vec::new();
        for (k, piece) in raw.iter().enumerate() {
            let mut entries = piece[key].2.clone();
            if name == "connectivity" {
                let corners = integers(piece, key).into_iter().map(|c| numbers[k][c] as i32);
                entries = corners.flat_map(i32::to_le_bytes).collect();
            }
            mapped.push(entries);
        }
        for (k, entries) in mapped.iter().enumerate() {
            let list = if of_cells { &cells[k] } else { &numbers[k] };
            assert_eq!(entries.len(), width * list.len(), "{key}");
            for (index, n) in list.iter().enumerate() {
                let place = &mut whole[*n];
                if of_cells || ghosts[k][index] == 0 {
                    assert!(place.is_none(), "{key} of {n} twice");
                    *place = Some(&entries[width * index..width * (index + 1)]);
                }
            }
        }
        for (k, entries) in mapped.iter().enumerate().filter(|_| !of_cells) {
            for (index, n) in numbers[k].iter().enumerate() {
                assert_eq!(
                    whole[*n].expect("there"),
                    &entries[width * index..width * (index + 1)],
                    "{key} of ghost {n}"
                );
            }
        }
        let mut values: Vec<u8> = whole
            .iter()
            .flat_map(|w| w.expect("all are there"))
            .copied()
            .collect();
        if name == "offsets" {
            let size = values.len() / 4;
            let per_cell =
                raw.iter().map(|p| p["Cells/connectivity"].2.len()).sum::<usize>() / 4 / size.max(1);
            values = (1..=size)
                .flat_map(|k| ((k * per_cell) as i32).to_le_bytes())
                .collect();
        }
        out.insert(key.clone(), (kind.clone(), raw[0][key].1, values));
    }
    (out, ghosts.iter().flatten().filter(|g| **g == 1).count())
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    let mut entries: Vec<String> = entries
        .map(|f| f.file_name().into_string().expect("a name"))
        .collect();
    entries.sort();
    entries
}

/// Asserts that results in pieces equal those of one rank; `pieces` returns the number of pieces of a model's
/// frame at a step.
fn assert_same(single: &Path, parallel: &Path, pieces: &dyn Fn(&str, usize) -> usize) {
    let index = |f: &Path| std::fs::read_to_string(f.join("results.pvd")).expect("an index");
    assert_eq!(index(single), index(parallel).replace(".pvtu", ".vtu"));
    for table in [
        "probes.csv",
        "energy.csv",
        "fragments.csv",
        "breaks.csv",
        "effects.csv",
    ] {
        let read_table = |f: &Path| std::fs::read(f.join(table)).expect(table);
        assert!(read_table(single) == read_table(parallel), "{table}");
    }
    let mut wanted = Vec::new();
    for file in index(parallel)
        .lines()
        .filter(|l| l.contains("<DataSet"))
        .map(|l| word(l, "file"))
    {
        let file = file.strip_prefix("vtu/").expect("in its folder");
        wanted.push(file.to_owned());
        let Some(stem) = file.strip_suffix(".pvtu") else {
            let [a, b] =
                [single, parallel].map(|f| std::fs::read(f.join("vtu").join(file)).expect("a frame"));
            assert!(a == b, "{file}");
            continue;
        };
        let (name, step) = stem.rsplit_once('_').expect("a step");
        let count = pieces(name, step.parse().expect("a number"));
        wanted.extend((0..count).map(|r| format!("{stem}_{r}.vtu")));
        let (joined, ghosts) = join_pieces(&parallel.join("vtu").join(file), count);
        let whole = arrays(&single.join(format!("vtu/{stem}.vtu")));
        assert!(
            joined.keys().eq(whole.keys()),
            "{file}: {:?} {:?}",
            joined.keys(),
            whole.keys()
        );
        joined
            .iter()
            .for_each(|(k, a)| assert!(*a == whole[k], "{file}: {k}"));
        assert!(ghosts > 10, "{file}: {ghosts}");
    }
    wanted.sort();
    assert_eq!(names(&parallel.join("vtu")), wanted);
}

#[test]
fn pieces_of_all_ranks_are_the_frame_of_one() {
    let folder = scratch("same");
    let (single, frames) = single_rank_run();
    let fragments = std::fs::read_to_string(single.join("fragments.csv")).expect("a table");
    assert!(fragments.lines().count() > 2 * frames, "{fragments}");
    let frame = arrays(&single.join("vtu/bar_00000000.vtu"));
    for name in ["radius [m]", "stress [Pa]", "contact force [N]", "damage [-]"] {
        assert!(frame.contains_key(&format!("PointData/{name}")), "{name}");
    }
    assert!(frame.contains_key("CellData/utilisation [-]"));
    let gum = arrays(&single.join("vtu/gum_00000000.vtu"));
    assert!(gum.contains_key("CellData/energy density [J/m3]") && gum.contains_key("PointData/strain [-]"));
    // The runs write in turn into the same folder; no piece of an earlier run may be left.
    let out = folder.join("out");
    for ranks in [4, 2] {
        let per_rank = on_ranks(ranks, &out);
        per_rank.into_iter().for_each(|r| assert!(r.is_ok(), "{r:?}"));
        assert_same(single, &out, &|name, _| {
            assert!(name != "grip" || ranks == 2, "{name}");
            ranks
        });
        let index = std::fs::read_to_string(out.join("results.pvd")).expect("an index");
        assert_eq!(
            index.matches(".pvtu").count(),
            frames * if ranks == 2 { 3 } else { 2 }
        );
    }
    assert_opened_by_vtk(single, &out, 3 * frames);
}

/// Reads frames with VTK itself, through the index, and compares them with those of one rank.
fn assert_opened_by_vtk(single: &Path, parallel: &Path, frames: usize) {
    let python = std::env::var("ARLEQUIN_PYTHON").unwrap_or_else(|_| "python3".into());
    let probe = Command::new(&python).args(["-c", "import pyvista"]).output();
    if !probe.is_ok_and(|o| o.status.success()) {
        println!("not run: {python} has no pyvista; name an interpreter that has it in ARLEQUIN_PYTHON");
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/pieces.py");
    let done = Command::new(&python)
        .arg(script)
        .args([single, parallel])
        .output()
        .expect("runs");
    let output = [&done.stdout[..], &done.stderr[..]].concat();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&output));
    assert!(
        output.starts_with(format!("same: {frames} frames").as_bytes()),
        "{}",
        String::from_utf8_lossy(&output)
    );
}

/// Returns the bits of the particle centres of a scene whose packing is read from a frame.
fn packed_as(frame: &Path) -> Vec<u64> {
    let text = BODIES.split("[model.grip]").next().expect("a body");
    let text = text.replace("role = \"fine\"\nshape", "shape").replace(
        "spacing = 0.3e-3\ndem.protocol = \"quench\"",
        &format!("dem.file = {frame:?}"),
    );
    let scene = Scene::from_text(text + "[time]\nend = 1e-7\n").expect("a scene");
    let built = scene.prepare().expect("built");
    let nodes = built.coupled().subdomains()[0].model().nodes().iter();
    nodes.flat_map(|x| [x.x, x.y, x.z].map(f64::to_bits)).collect()
}

#[test]
fn spheres_are_read_from_pieces_as_from_one_file() {
    let (single, _) = single_rank_run();
    let out = scratch("packing").join("out");
    for r in on_ranks(3, &out) {
        r.expect("runs");
    }
    let [a, b] = [
        single.join("vtu/bar_00000000.vtu"),
        out.join("vtu/bar_00000000.pvtu"),
    ]
    .map(|f| packed_as(&f));
    assert!(a.len() > 3_000 && a == b, "{} {}", a.len(), b.len());
}

/// Observer that ends the run at a step.
struct Stop(usize);

impl Observer for Stop {
    fn step(&mut self, run: &Coupled<f64>, _: usize) -> ControlFlow<()> {
        if run.steps() >= self.0 {
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }
}

#[test]
fn a_run_in_pieces_goes_on_with_another_number_of_ranks() {
    let folder = scratch("resumed");
    let (single, _) = single_rank_run();
    let half = scene(true).prepare().expect("built").built().steps / 2;
    for (first, then) in [(4, 2), (1, 3)] {
        let place = folder.join(format!("{first}-{then}"));
        let stopped = threads::run(first, 1, WAIT, |c| {
            let done = run(&scene(true).on_ranks(c)?, &place, &mut Stop(half));
            done.map(|r| (r.end, r.run.steps()))
        });
        let mut resumed_at = 0;
        for s in stopped {
            let (end, steps) = s.expect("there").expect("stops");
            assert_eq!(end, End::Interrupted);
            resumed_at = steps;
        }
        let gone_on = threads::run(then, 1, WAIT, |c| {
            resume_on(&place, Some(c))?.run(&mut Silent).map(|r| r.end)
        });
        for g in gone_on {
            assert_eq!(g.expect("there").expect("goes on"), End::Complete);
        }
        assert_same(single, &place, &|_, step| {
            if step <= resumed_at { first } else { then }
        });
    }
}

/// Observer that creates a folder at the path where a rank is about to write.
struct InTheWay(PathBuf);

impl Observer for InTheWay {
    fn step(&mut self, run: &Coupled<f64>, _: usize) -> ControlFlow<()> {
        if run.steps() == 1 {
            std::fs::create_dir_all(&self.0).expect("a folder");
        }
        ControlFlow::Continue(())
    }
}

#[test]
fn a_piece_that_cannot_be_written_ends_all_ranks_by_name_and_leaves_no_half_frame() {
    let folder = scratch("failing");
    let (single, frames) = single_rank_run();
    assert!(frames > 3);
    let index = std::fs::read_to_string(single.join("results.pvd")).expect("an index");
    let frames = index.lines().filter(|l| l.contains("name=\"bar\""));
    let second = frames
        .map(|l| word(l, "file").to_owned())
        .nth(1)
        .expect("a frame");
    let out = folder.join("out");
    let stem = second.strip_suffix(".vtu").expect("a frame");
    let taken = folder.join(format!("out.unfinished/{stem}_1.vtu"));
    let per_rank = threads::run(3, 1, WAIT, |c| {
        let scene = scene(true).on_ranks(c)?;
        run(&scene, &out, &mut InTheWay(taken.clone())).map(|_| ())
    });
    for (rank, r) in per_rank.into_iter().enumerate() {
        let e = r.expect("there").expect_err("fails");
        assert!(e.is_everywhere() && !e.is_input(), "{rank}: {e}");
        let text = e.to_string();
        match rank {
            1 => assert!(
                matches!(e, Error::Agreed(_)) && text.contains(&format!("{stem}_1.vtu")),
                "{text}"
            ),
            _ => assert!(text.contains("rank 1 has an error"), "{text}"),
        }
    }
    // The earlier frames are whole, and nothing of the failed frame is left.
    let index = std::fs::read_to_string(out.join("results.pvd")).expect("an index");
    assert_eq!(index.matches("name=\"bar\"").count(), 1, "{index}");
    let step = stem.rsplit_once('_').expect("a step").1;
    let leftovers = names(&out.join("vtu")).into_iter().filter(|n| n.contains(step));
    assert_eq!(
        leftovers.collect::<Vec<_>>(),
        [format!("bar_{step}_1.vtu")],
        "the folder in the way alone"
    );
    join_pieces(&out.join("vtu/bar_00000000.pvtu"), 3);
}

/// A preview predicts the bytes of all arrays in the frames, with bonds that can break and without.
#[test]
fn frames_have_the_bytes_that_a_preview_predicts() {
    let bodies = BODIES.split("[[effect]]").next().expect("models");
    let fields = "[\"displacement\", \"velocity\", \"weights\", \"energy-density\", \"multipliers\", \"stress\", \"strain\", \
                  \"von-mises\", \"principal-stress\", \"bond-forces\"]";
    let fracture =
        "[[effect]]\nmodels = [\"bar\"]\nfracture = { criterion = \"rankine\", strength = 100e6 }\n";
    for effect in ["", fracture] {
        let text = format!(
            "{bodies}{effect}[[initial]]\nmodels = [\"gum\"]\nvelocity.uniform = [1.0, 0.0, 0.0]\n[time]\nsteps = 2\n\
             [output]\nevery = 2\nplots = false\nfields = {fields}\n"
        );
        let scene = Scene::from_text(text).expect("a scene");
        let predicted = scene.prepare().expect("built").preview().output_bytes;
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("bytes-of-frames");
        let run_folder = RunFolder::new(&scene, Some(&folder), true).expect("a folder");
        let prepared = scene.prepare().expect("built");
        prepared.run_into(run_folder, &mut Silent).expect("runs");
        let files = std::fs::read_dir(folder.join("vtu")).expect("frames");
        let bytes = |path: PathBuf| arrays(&path).values().map(|a| a.2.len()).sum::<usize>();
        let written: usize = files.map(|f| bytes(f.expect("a file").path())).sum();
        assert_eq!(predicted, written, "{effect}");
    }
}
