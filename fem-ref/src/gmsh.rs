//! Import of Gmsh meshes, format 4.1, ascii or binary.
//!
//! One element kind fills the domain: hexahedra, tetrahedra, or lines where there are no solids. Physical groups
//! become named groups: those of surfaces get facets (their boundary faces; inner surfaces are groups of nodes only),
//! all get nodes. A group without a name in the file is called `point-1`, `curve-2`, `surface-3` or `volume-4` after
//! its dimension and tag. Nodes are renumbered for locality; Gmsh's own tags are not kept.

mod surface;

pub use surface::{Triangles, load_surface};

use crate::element::ElementKind;
use crate::error::{Error, Result};
use crate::mesh::{Facet, Mesh};
use arlequin_core::Real;
use mshio::mshfile::{ElementBlock, ElementType, Entities, MshFile};
use nalgebra::Point3;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

type File = MshFile<u64, i32, f64>;
/// Index of every node tag.
type NodeIndex = HashMap<u64, u32>;
type Block = ElementBlock<u64, i32>;

/// Reads a `.msh` file.
///
/// # Errors
/// [`Error::File`] if it cannot be read, otherwise as [`parse`].
pub fn load<T: Real>(path: impl AsRef<Path>) -> Result<Mesh<T>> {
    let path = path.as_ref();
    let bytes = std::fs::read(path).map_err(|e| Error::File {
        path: path.display().to_string(),
        message: e.to_string(),
    })?;
    parse(&bytes)
}

/// Reads the content of a `.msh` file. Bars get a section of 1 m²; see [`Mesh::with_section`].
///
/// ```
/// let text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n\
///     $Nodes\n1 4 1 4\n3 1 0 4\n1\n2\n3\n4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n$EndNodes\n\
///     $Elements\n1 1 1 1\n3 1 4 1\n1 1 2 3 4\n$EndElements\n";
/// let mesh = fem_ref::gmsh::parse::<f64>(text.as_bytes())?;
/// assert_eq!((mesh.kind().name(), mesh.nodes().len()), ("tet4", 4));
/// # Ok::<(), fem_ref::Error>(())
/// ```
///
/// # Errors
/// [`Error::Gmsh`] for another version, a broken section, mixed or unsupported elements, unknown or repeated node
/// tags; as [`Mesh::new`] for meshes that are not valid.
pub fn parse<T: Real>(bytes: &[u8]) -> Result<Mesh<T>> {
    let bytes = prepared(bytes)?;
    let file = mshio::parse_msh_bytes(&bytes).map_err(|e| {
        let trace = e.backtrace.iter().rev().map(|(_, kind)| kind);
        let known = trace.filter(|kind| !kind.is_nom_error()).map(ToString::to_string);
        fault(format!(
            "a section is broken: {}; save the mesh again in format 4.1",
            known.collect::<Vec<_>>().join(": ")
        ))
    })?;
    let names = physical_names(&bytes)?;
    let (nodes, index) = node_index(&file)?;
    let blocks = file
        .data
        .elements
        .as_ref()
        .map_or(&[] as &[Block], |e| &e.element_blocks);
    let kind = element_kind(blocks)?;
    let of_kind = blocks.iter().filter(|b| b.element_type == gmsh_type(kind));
    let mut connectivity = Vec::new();
    for element in of_kind.flat_map(|b| &b.elements) {
        for tag in &element.nodes {
            connectivity.push(lookup(&index, *tag, element.element_tag)?);
        }
    }
    let mut mesh = Mesh::new(kind, nodes, connectivity)?;
    if let Some(entities) = &file.data.entities {
        for (name, group) in collect_groups(blocks, entities, &names, &index)? {
            add_group(&mut mesh, &name, group);
        }
    }
    mesh.set_volumes(volumes(blocks, kind, file.data.entities.as_ref(), &names));
    Ok(mesh.renumbered())
}

fn fault(message: impl Into<String>) -> Error {
    Error::Gmsh {
        message: message.into(),
    }
}

/// Position behind a line that holds `word` alone.
fn behind(bytes: &[u8], word: &str) -> Option<usize> {
    let n = word.len();
    let mut at = 0;
    while let Some(k) = bytes[at..].windows(n).position(|w| w == word.as_bytes()) {
        at += k + n;
        match &bytes[at..] {
            [b'\n', ..] => return Some(at + 1),
            [b'\r', b'\n', ..] => return Some(at + 2),
            _ => {}
        }
    }
    None
}

fn line(bytes: &[u8], at: usize) -> &[u8] {
    let rest = &bytes[at..];
    &rest[..rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len())]
}

/// Checks what the parser takes for granted, and makes it keep node tags: it drops them where the header says that
/// they are dense, although blocks may list dense tags in any order. So the header's largest tag is raised.
fn prepared(bytes: &[u8]) -> Result<Vec<u8>> {
    let Some(at) = behind(bytes, "$MeshFormat") else {
        return Err(fault(
            "the file does not start with $MeshFormat; is it a .msh file?",
        ));
    };
    let header = String::from_utf8_lossy(line(bytes, at)).into_owned();
    let words: Vec<&str> = header.split_whitespace().collect();
    let [version, file_type, size] = words[..] else {
        return Err(fault(format!(
            "$MeshFormat holds '{header}' instead of version, type and size"
        )));
    };
    if version != "4.1" {
        return Err(fault(format!(
            "format {version} is not supported; save in 4.1 (Mesh.MshFileVersion = 4.1)"
        )));
    }
    let width = match (file_type, size) {
        ("0", _) => None,
        ("1", "4") => Some(4),
        ("1", "8") => Some(8),
        _ => {
            return Err(fault(format!(
                "file type {file_type} with size {size} is not supported"
            )));
        }
    };
    if !matches!(size, "4" | "8") {
        return Err(fault(format!(
            "size {size} of integers is not supported; use 4 or 8"
        )));
    }
    let little = bytes.get(at + header.len() + 1) == Some(&1);
    let mut out = bytes.to_vec();
    for (section, name) in [("$Nodes", "nodes"), ("$Elements", "elements")] {
        let Some(at) = behind(&out, section) else {
            return Err(fault(format!(
                "there is no {section} section; the mesh has no {name}"
            )));
        };
        let (counts, text) = section_counts(&out, at, width, little)
            .ok_or_else(|| fault(format!("the header of section {section} is broken")))?;
        if counts[1] == 0 {
            return Err(fault(format!(
                "section {section} is empty; mesh the geometry before saving"
            )));
        }
        if section == "$Nodes" {
            match width {
                None => {
                    let new = format!("{} {} {} {}", counts[0], counts[1], counts[2], u64::MAX);
                    out.splice(at..at + text, new.into_bytes());
                }
                Some(w) => out[at + 3 * w..at + 4 * w].fill(u8::MAX),
            }
        }
    }
    Ok(out)
}

/// The four numbers that open a section, and the length of their line (ascii).
fn section_counts(bytes: &[u8], at: usize, width: Option<usize>, little: bool) -> Option<([u64; 4], usize)> {
    let Some(w) = width else {
        let text = std::str::from_utf8(line(bytes, at)).ok()?.trim_end();
        let numbers: Vec<u64> = text.split_whitespace().map_while(|s| s.parse().ok()).collect();
        return Some((numbers.try_into().ok()?, text.len()));
    };
    let mut out = [0; 4];
    for (k, out) in out.iter_mut().enumerate() {
        let raw = bytes.get(at + k * w..at + (k + 1) * w)?;
        let fold = |n: u64, b: &u8| n << 8 | u64::from(*b);
        *out = if little {
            raw.iter().rev().fold(0, fold)
        } else {
            raw.iter().fold(0, fold)
        };
    }
    Some((out, 0))
}

/// Names of the physical groups by dimension and tag.
fn physical_names(bytes: &[u8]) -> Result<BTreeMap<(i32, i32), String>> {
    let mut names = BTreeMap::new();
    let Some(mut at) = behind(bytes, "$PhysicalNames") else {
        return Ok(names);
    };
    at += line(bytes, at).len() + 1;
    while at < bytes.len() {
        let text = String::from_utf8_lossy(line(bytes, at)).into_owned();
        if text.starts_with("$EndPhysicalNames") {
            return Ok(names);
        }
        let mut words = text.splitn(3, ' ');
        let mut number = || words.next().and_then(|w| w.parse::<i32>().ok());
        let (dimension, tag) = (number(), number());
        let name = words
            .next()
            .and_then(|w| w.trim().strip_prefix('"')?.strip_suffix('"'));
        match (dimension, tag, name) {
            (Some(d), Some(t), Some(n)) => names.insert((d, t), n.to_owned()),
            _ => {
                return Err(fault(format!(
                    "$PhysicalNames holds the broken line '{}'",
                    text.trim()
                )));
            }
        };
        at += line(bytes, at).len() + 1;
    }
    Err(fault("$PhysicalNames is not closed by $EndPhysicalNames"))
}

/// Node positions and the index of every node tag.
fn node_index<T: Real>(file: &File) -> Result<(Vec<Point3<T>>, NodeIndex)> {
    let (mut nodes, mut index) = (Vec::new(), HashMap::new());
    for block in file.data.nodes.iter().flat_map(|n| &n.node_blocks) {
        let first = nodes.len();
        nodes.extend(block.nodes.iter().map(|n| Point3::new(n.x, n.y, n.z).map(T::of)));
        for (tag, k) in block.node_tags.iter().flatten() {
            if index.insert(*tag, (first + k) as u32).is_some() {
                return Err(fault(format!("node tag {tag} occurs twice; renumber the mesh")));
            }
        }
        if index.len() != nodes.len() {
            let text = format!(
                "a block of {} nodes on entity {} repeats a node tag; renumber the mesh",
                block.nodes.len(),
                block.entity_tag
            );
            return Err(fault(text));
        }
    }
    Ok((nodes, index))
}

fn lookup(index: &NodeIndex, tag: u64, element: u64) -> Result<u32> {
    index.get(&tag).copied().ok_or_else(|| {
        fault(format!(
            "element {element} refers to node {tag}, which is not in $Nodes"
        ))
    })
}

fn gmsh_type(kind: ElementKind) -> ElementType {
    match kind {
        ElementKind::Bar2 => ElementType::Lin2,
        ElementKind::Tet4 => ElementType::Tet4,
        ElementKind::Hex8 => ElementType::Hex8,
    }
}

/// The one kind that fills the domain.
fn element_kind(blocks: &[Block]) -> Result<ElementKind> {
    let count = |t: ElementType| -> usize {
        let those = blocks.iter().filter(|b| b.element_type == t);
        those.map(|b| b.elements.len()).sum()
    };
    use ElementType::{Hex8, Lin2, Pnt, Qua4, Tet4, Tri3};
    let known = [Pnt, Lin2, Tri3, Qua4, Tet4, Hex8];
    if let Some(block) = blocks.iter().find(|b| !known.contains(&b.element_type)) {
        let t = block.element_type;
        return Err(fault(format!(
            "{} elements of type {t:?} are not supported; use Lin2, Tet4 or Hex8 of first order",
            count(t)
        )));
    }
    match (count(Tet4), count(Hex8)) {
        (0, 0) => {}
        (_, 0) => return Ok(ElementKind::Tet4),
        (0, _) => return Ok(ElementKind::Hex8),
        (tets, hexes) => {
            return Err(fault(format!(
                "{tets} Tet4 and {hexes} Hex8 elements are mixed; mesh all volumes with one kind"
            )));
        }
    }
    match (count(Tri3) + count(Qua4), count(Lin2)) {
        (0, 0) => Err(fault(
            "there is no Lin2, Tet4 or Hex8 element; mesh curves or volumes",
        )),
        (0, _) => Ok(ElementKind::Bar2),
        (faces, _) => Err(fault(format!(
            "{faces} Tri3 and Qua4 elements bound no volume; mesh in three dimensions"
        ))),
    }
}

/// Names of the parts that the elements of the domain belong to: physical groups, or else entities.
fn volumes(
    blocks: &[Block],
    kind: ElementKind,
    entities: Option<&Entities<i32, f64>>,
    names: &BTreeMap<(i32, i32), String>,
) -> Vec<String> {
    let mut out = Vec::new();
    for block in blocks
        .iter()
        .filter(|b| b.element_type == gmsh_type(kind) && b.entity_dim == 3)
    {
        let volume = entities.and_then(|e| e.volumes.iter().find(|v| v.tag == block.entity_tag));
        let group = volume
            .and_then(|v| v.physical_tags.first())
            .map(|t| t.saturating_abs());
        let name = match group {
            Some(tag) => names
                .get(&(3, tag))
                .cloned()
                .unwrap_or_else(|| format!("volume-{tag}")),
            None => format!("entity {}", block.entity_tag),
        };
        if !out.contains(&name) {
            out.push(name);
        }
    }
    out
}

/// Elements of one physical group as node lists, with their dimension.
type RawGroup = Vec<(i32, Vec<u32>)>;

fn collect_groups(
    blocks: &[Block],
    entities: &Entities<i32, f64>,
    names: &BTreeMap<(i32, i32), String>,
    index: &NodeIndex,
) -> Result<BTreeMap<String, RawGroup>> {
    let mut physical: HashMap<(i32, i32), &[i32]> = HashMap::new();
    physical.extend(entities.points.iter().map(|e| ((0, e.tag), &e.physical_tags[..])));
    physical.extend(entities.curves.iter().map(|e| ((1, e.tag), &e.physical_tags[..])));
    physical.extend(
        entities
            .surfaces
            .iter()
            .map(|e| ((2, e.tag), &e.physical_tags[..])),
    );
    physical.extend(
        entities
            .volumes
            .iter()
            .map(|e| ((3, e.tag), &e.physical_tags[..])),
    );
    let mut groups: BTreeMap<String, RawGroup> = BTreeMap::new();
    for block in blocks {
        let dimension = block.entity_dim;
        let tags = physical.get(&(dimension, block.entity_tag)).copied();
        for tag in tags.unwrap_or_default() {
            // A negative tag means that the entity is turned around in the group.
            let tag = tag.saturating_abs();
            let word = ["point", "curve", "surface", "volume"]
                .get(dimension as usize)
                .unwrap_or(&"part");
            let name = names.get(&(dimension, tag)).cloned();
            let group = groups
                .entry(name.unwrap_or_else(|| format!("{word}-{tag}")))
                .or_default();
            for element in &block.elements {
                let nodes = element
                    .nodes
                    .iter()
                    .map(|n| lookup(index, *n, element.element_tag));
                group.push((dimension, nodes.collect::<Result<_>>()?));
            }
        }
    }
    Ok(groups)
}

fn add_group<T: Real>(mesh: &mut Mesh<T>, name: &str, group: RawGroup) {
    let facet_dimension = match mesh.kind() {
        ElementKind::Bar2 => 0,
        ElementKind::Tet4 | ElementKind::Hex8 => 2,
    };
    let sorted = |mut nodes: Vec<u32>| {
        nodes.sort_unstable();
        nodes
    };
    let mut faces: HashMap<Vec<u32>, Facet> = HashMap::new();
    if group.iter().any(|(d, _)| *d == facet_dimension) {
        let boundary = mesh.boundary();
        faces.extend(boundary.into_iter().map(|f| (sorted(mesh.facet_nodes(f)), f)));
    }
    let (mut nodes, mut facets) = (Vec::new(), Vec::new());
    for (dimension, corners) in group {
        nodes.extend_from_slice(&corners);
        if dimension == facet_dimension {
            facets.extend(faces.get(&sorted(corners)));
        }
    }
    mesh.set_group(name, nodes, facets);
}
