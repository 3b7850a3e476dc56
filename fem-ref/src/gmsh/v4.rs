//! Format 4.1, and the sections that all formats share.

use super::contents::{Block, Contents, NodeIndex};
use super::fault;
use crate::error::Result;
use mshio::mshfile::{Entities, MshFile};
use nalgebra::Point3;
use std::collections::{BTreeMap, HashMap};

type File = MshFile<u64, i32, f64>;

/// Contents of the first section of a file.
#[derive(Debug)]
pub(super) struct Header {
    pub version: String,
    /// Bytes per integer; `None` for text.
    pub width: Option<usize>,
    /// True if the lowest byte of a number comes first.
    pub little: bool,
    /// Position after the section's line.
    pub end: usize,
}

/// Reads the first section.
pub(super) fn header(bytes: &[u8]) -> Result<Header> {
    let Some(position) = behind(bytes, "$MeshFormat") else {
        return Err(fault(
            "the file does not start with $MeshFormat; is it a .msh file?",
        ));
    };
    let text = String::from_utf8_lossy(line(bytes, position)).into_owned();
    let words: Vec<&str> = text.split_whitespace().collect();
    let [version, file_type, size] = words[..] else {
        return Err(fault(format!(
            "$MeshFormat holds '{text}' instead of version, type and size"
        )));
    };
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
    let end = position + text.len() + 1;
    Ok(Header {
        version: version.to_owned(),
        width,
        little: bytes.get(end) == Some(&1),
        end,
    })
}

/// Reads everything except names.
pub(super) fn read(bytes: &[u8], header: &Header) -> Result<Contents> {
    let bytes = prepared(bytes, header)?;
    let file = mshio::parse_msh_bytes(&bytes).map_err(|e| {
        let trace = e.backtrace.iter().rev().map(|(_, kind)| kind);
        let known = trace.filter(|kind| !kind.is_nom_error()).map(ToString::to_string);
        fault(format!(
            "a section is broken: {}; save the mesh again in format 4.1",
            known.collect::<Vec<_>>().join(": ")
        ))
    })?;
    let (nodes, index) = node_index(&file)?;
    let physical = file.data.entities.as_ref().map(physical_tags).unwrap_or_default();
    let blocks = file.data.elements.into_iter().flat_map(|e| e.element_blocks);
    let blocks = blocks.map(|b| Block {
        dimension: b.entity_dim,
        entity: b.entity_tag,
        physical: physical
            .get(&(b.entity_dim, b.entity_tag))
            .cloned()
            .unwrap_or_default(),
        element_type: b.element_type,
        elements: b.elements,
    });
    Ok(Contents {
        nodes,
        index,
        blocks: blocks.collect(),
        ..Contents::default()
    })
}

/// Physical groups of every entity, by dimension and tag.
fn physical_tags(entities: &Entities<i32, f64>) -> HashMap<(i32, i32), Vec<i32>> {
    let points = entities.points.iter().map(|e| (0, e.tag, &e.physical_tags));
    let curves = entities.curves.iter().map(|e| (1, e.tag, &e.physical_tags));
    let surfaces = entities.surfaces.iter().map(|e| (2, e.tag, &e.physical_tags));
    let volumes = entities.volumes.iter().map(|e| (3, e.tag, &e.physical_tags));
    let tagged = points.chain(curves).chain(surfaces).chain(volumes);
    tagged
        .map(|(dimension, tag, physical)| ((dimension, tag), physical.clone()))
        .collect()
}

/// Position after the first line that ends with `word`.
pub(super) fn behind(bytes: &[u8], word: &str) -> Option<usize> {
    let n = word.len();
    let mut end = 0;
    while let Some(k) = bytes[end..].windows(n).position(|w| w == word.as_bytes()) {
        end += k + n;
        match &bytes[end..] {
            [b'\n', ..] => return Some(end + 1),
            [b'\r', b'\n', ..] => return Some(end + 2),
            _ => {}
        }
    }
    None
}

pub(super) fn line(bytes: &[u8], position: usize) -> &[u8] {
    let tail = &bytes[position..];
    &tail[..tail.iter().position(|&b| b == b'\n').unwrap_or(tail.len())]
}

/// Checks what the parser takes for granted, and makes it keep node tags.
fn prepared(bytes: &[u8], header: &Header) -> Result<Vec<u8>> {
    let (width, little) = (header.width, header.little);
    let mut out = bytes.to_vec();
    for (section, name) in [("$Nodes", "nodes"), ("$Elements", "elements")] {
        let Some(position) = behind(&out, section) else {
            return Err(fault(format!(
                "there is no {section} section; the mesh has no {name}"
            )));
        };
        let (counts, text) = section_counts(&out, position, width, little)
            .ok_or_else(|| fault(format!("the header of section {section} is broken")))?;
        if counts[1] == 0 {
            return Err(fault(format!(
                "section {section} is empty; mesh the geometry before saving"
            )));
        }
        // The parser drops the tags if the header says that they are dense, although blocks may list dense
        // tags in any order. A larger largest tag makes it keep them.
        if section == "$Nodes" {
            match width {
                None => {
                    let new = format!("{} {} {} {}", counts[0], counts[1], counts[2], u64::MAX);
                    out.splice(position..position + text, new.into_bytes());
                }
                Some(w) => out[position + 3 * w..position + 4 * w].fill(u8::MAX),
            }
        }
    }
    Ok(out)
}

/// The four numbers at the start of a section, and the length of their line (ascii only, else 0).
fn section_counts(
    bytes: &[u8],
    position: usize,
    width: Option<usize>,
    little: bool,
) -> Option<([u64; 4], usize)> {
    let Some(w) = width else {
        let text = std::str::from_utf8(line(bytes, position)).ok()?.trim_end();
        let numbers: Vec<u64> = text.split_whitespace().map_while(|s| s.parse().ok()).collect();
        return Some((numbers.try_into().ok()?, text.len()));
    };
    let mut out = [0; 4];
    for (k, out) in out.iter_mut().enumerate() {
        let raw = bytes.get(position + k * w..position + (k + 1) * w)?;
        let fold = |n: u64, b: &u8| n << 8 | u64::from(*b);
        *out = if little {
            raw.iter().rev().fold(0, fold)
        } else {
            raw.iter().fold(0, fold)
        };
    }
    Some((out, 0))
}

/// Names of the physical groups, by dimension and tag.
pub(super) fn physical_names(bytes: &[u8]) -> Result<BTreeMap<(i32, i32), String>> {
    let mut names = BTreeMap::new();
    let Some(mut position) = behind(bytes, "$PhysicalNames") else {
        return Ok(names);
    };
    position += line(bytes, position).len() + 1;
    while position < bytes.len() {
        let text = String::from_utf8_lossy(line(bytes, position)).into_owned();
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
        position += line(bytes, position).len() + 1;
    }
    Err(fault("$PhysicalNames is not closed by $EndPhysicalNames"))
}

/// Node positions, and the index of every node tag.
fn node_index(file: &File) -> Result<(Vec<Point3<f64>>, NodeIndex)> {
    let (mut nodes, mut index) = (Vec::new(), HashMap::new());
    for block in file.data.nodes.iter().flat_map(|n| &n.node_blocks) {
        let first = nodes.len();
        nodes.extend(block.nodes.iter().map(|n| Point3::new(n.x, n.y, n.z)));
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
