//! Format 2.2, ascii or binary: each element has the tags of its entity and of one physical group.

use super::contents::{Block, Contents};
use super::fault;
use super::v4::{Header, behind, line};
use crate::error::Result;
use mshio::mshfile::{Element, ElementType};
use nalgebra::Point3;
use std::collections::{BTreeMap, HashMap};

/// One element as the file lists it.
struct Listed {
    number: u64,
    element_type: ElementType,
    physical: i32,
    entity: i32,
    nodes: Vec<u64>,
}

/// Reads everything except names.
pub(super) fn read(bytes: &[u8], header: &Header) -> Result<Contents> {
    if header.width.is_some_and(|w| w != 8) {
        return Err(fault(
            "format 2.2 with numbers of 4 bytes is not supported; save in 4.1",
        ));
    }
    // In binary files the number one follows the header: its bytes tell their order.
    let little = match (header.width, bytes.get(header.end..header.end + 4)) {
        (None, _) | (_, Some([1, 0, 0, 0])) => true,
        (_, Some([0, 0, 0, 1])) => false,
        _ => {
            return Err(fault(
                "the number 1 does not follow $MeshFormat; save the mesh again",
            ));
        }
    };
    let start = |section: &str, name: &str| {
        let position = behind(bytes, section)
            .ok_or_else(|| fault(format!("there is no {section} section; the mesh has no {name}")))?;
        let count = std::str::from_utf8(line(bytes, position))
            .ok()
            .and_then(|t| t.trim().parse::<u64>().ok());
        match count {
            None => Err(fault(format!("the header of section {section} is broken"))),
            Some(0) => Err(fault(format!(
                "section {section} is empty; mesh the geometry before saving"
            ))),
            Some(n) => Ok((n, position + line(bytes, position).len() + 1)),
        }
    };
    let source = |position: usize| Source {
        bytes: bytes.get(position..).unwrap_or(&[]),
        binary: header.width.is_some(),
        little,
    };
    let (count, position) = start("$Nodes", "nodes")?;
    let mut out = Contents::default();
    nodes(source(position), count, &mut out)?;
    let (count, position) = start("$Elements", "elements")?;
    let listed = elements(source(position), count)?;
    out.blocks = blocks(listed);
    Ok(out)
}

fn nodes(mut source: Source<'_>, count: u64, out: &mut Contents) -> Result<()> {
    for k in 0..count {
        let read = (|| {
            Some((
                source.integer()?,
                [source.real()?, source.real()?, source.real()?],
            ))
        })();
        let Some((tag, x)) = read else {
            return Err(fault(format!(
                "section $Nodes is broken at its node {} of {count}; save the mesh again",
                k + 1
            )));
        };
        let tag = u64::try_from(tag)
            .map_err(|_| fault(format!("node tag {tag} is negative; renumber the mesh")))?;
        if out.index.insert(tag, out.nodes.len() as u32).is_some() {
            return Err(fault(format!("node tag {tag} occurs twice; renumber the mesh")));
        }
        out.nodes.push(Point3::from(x));
    }
    Ok(())
}

fn elements(mut source: Source<'_>, count: u64) -> Result<Vec<Listed>> {
    let mut out = Vec::new();
    // Not `Vec::with_capacity(count)`: a broken file may announce any number.
    while (out.len() as u64) < count {
        let before = out.len();
        let good = if source.binary {
            binary_elements(&mut source, count, &mut out)
        } else {
            text_element(&mut source, &mut out)
        };
        if good?.is_none() || out.len() == before {
            return Err(fault(format!(
                "section $Elements is broken at its element {} of {count}; save the mesh again",
                before + 1
            )));
        }
    }
    Ok(out)
}

/// Reads an element of a text file: `number type count-of-tags tags… nodes…` on one line.
fn text_element(source: &mut Source<'_>, out: &mut Vec<Listed>) -> Result<Option<()>> {
    let Some([number, code, tags]) = source.integers() else {
        return Ok(None);
    };
    let (element_type, n) = known(code)?;
    let mut physical = 0;
    let mut entity = 0;
    for k in 0..tags {
        let Some(tag) = source.integer() else {
            return Ok(None);
        };
        match k {
            0 => physical = tag,
            1 => entity = tag,
            _ => {}
        }
    }
    Ok(listed(source, number, element_type, [physical, entity], n).map(|e| out.push(e)))
}

/// Reads elements of a binary file: a header `type count count-of-tags`, then `number tags… nodes…` each.
fn binary_elements(source: &mut Source<'_>, count: u64, out: &mut Vec<Listed>) -> Result<Option<()>> {
    let Some([code, follow, tags]) = source.integers() else {
        return Ok(None);
    };
    let (element_type, n) = known(code)?;
    // More elements than announced, or a count of tags that no program writes: the file is broken.
    if follow < 1 || follow as u64 > count - out.len() as u64 || !(0..=64).contains(&tags) {
        return Ok(None);
    }
    for _ in 0..follow {
        let Some(number) = source.integer() else {
            return Ok(None);
        };
        let mut element_tags = [0; 2];
        for k in 0..tags {
            let Some(tag) = source.integer() else {
                return Ok(None);
            };
            if let Some(slot) = element_tags.get_mut(k as usize) {
                *slot = tag;
            }
        }
        match listed(source, number, element_type, element_tags, n) {
            Some(e) => out.push(e),
            None => return Ok(None),
        }
    }
    Ok(Some(()))
}

fn listed(
    source: &mut Source<'_>,
    number: i64,
    element_type: ElementType,
    tags: [i64; 2],
    n: usize,
) -> Option<Listed> {
    let nodes = (0..n).map(|_| u64::try_from(source.integer()?).ok());
    Some(Listed {
        number: u64::try_from(number).ok()?,
        element_type,
        physical: i32::try_from(tags[0]).ok()?,
        entity: i32::try_from(tags[1]).ok()?,
        nodes: nodes.collect::<Option<_>>()?,
    })
}

/// Sorts elements into blocks of one type, entity and set of groups.
fn blocks(listed: Vec<Listed>) -> Vec<Block> {
    let mut indices: HashMap<(i32, i32, Vec<u64>), usize> = HashMap::new();
    let mut merged: Vec<(Listed, Vec<i32>)> = Vec::new();
    for e in listed {
        // The file lists an entity in several groups once per group, reversed if the group's tag is negative.
        // So an element is identified by the set of its nodes.
        let mut nodes = e.nodes.clone();
        nodes.sort_unstable();
        let key = (e.element_type as i32, e.entity, nodes);
        let groups = (e.physical != 0).then_some(e.physical);
        match indices.get(&key) {
            // A repetition in the same group is kept, for the check of repeated elements in `assemble`.
            Some(&k) if groups.is_none_or(|g| merged[k].1.contains(&g)) => {
                merged.push((e, merged[k].1.clone()));
            }
            Some(&k) => merged[k].1.extend(groups),
            None => {
                indices.insert(key, merged.len());
                merged.push((e, groups.into_iter().collect()));
            }
        }
    }
    let mut blocks: Vec<Block> = Vec::new();
    let mut places: BTreeMap<(i32, i32, Vec<i32>), usize> = BTreeMap::new();
    for (e, physical) in merged {
        let key = (e.element_type as i32, e.entity, physical.clone());
        let place = *places.entry(key).or_insert_with(|| {
            blocks.push(Block {
                dimension: dimension(e.element_type),
                entity: e.entity,
                physical,
                element_type: e.element_type,
                elements: Vec::new(),
            });
            blocks.len() - 1
        });
        blocks[place].elements.push(Element {
            element_tag: e.number,
            nodes: e.nodes,
        });
    }
    blocks
}

/// Element type of a code, with its number of nodes.
fn known(code: i64) -> Result<(ElementType, usize)> {
    use ElementType as E;
    Ok(match code {
        1 => (E::Lin2, 2),
        2 => (E::Tri3, 3),
        3 => (E::Qua4, 4),
        4 => (E::Tet4, 4),
        5 => (E::Hex8, 8),
        6 => (E::Pri6, 6),
        7 => (E::Pyr5, 5),
        8 => (E::Lin3, 3),
        9 => (E::Tri6, 6),
        10 => (E::Qua9, 9),
        11 => (E::Tet10, 10),
        12 => (E::Hex27, 27),
        15 => (E::Pnt, 1),
        16 => (E::Qua8, 8),
        17 => (E::Hex20, 20),
        other => {
            return Err(fault(format!(
                "elements of the type with code {other} are not supported; use lines, tetrahedra or hexahedra"
            )));
        }
    })
}

fn dimension(element: ElementType) -> i32 {
    use ElementType as E;
    match element {
        E::Pnt => 0,
        E::Lin2 | E::Lin3 => 1,
        E::Tri3 | E::Tri6 | E::Qua4 | E::Qua8 | E::Qua9 => 2,
        _ => 3,
    }
}

/// Reads one number after another, from words of text or from bytes.
struct Source<'a> {
    bytes: &'a [u8],
    binary: bool,
    little: bool,
}

impl Source<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, remaining) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = remaining;
        let mut out = *first;
        if !self.little {
            out.reverse();
        }
        Some(out)
    }

    fn word(&mut self) -> Option<&str> {
        let text = self.bytes.trim_ascii_start();
        let end = text
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(text.len());
        let (word, remaining) = text.split_at(end);
        self.bytes = remaining;
        std::str::from_utf8(word).ok()
    }

    fn integer(&mut self) -> Option<i64> {
        match self.binary {
            true => self.take::<4>().map(|b| i64::from(i32::from_le_bytes(b))),
            false => self.word()?.parse().ok(),
        }
    }

    fn integers<const N: usize>(&mut self) -> Option<[i64; N]> {
        let mut out = [0; N];
        for slot in &mut out {
            *slot = self.integer()?;
        }
        Some(out)
    }

    fn real(&mut self) -> Option<f64> {
        match self.binary {
            true => self.take::<8>().map(f64::from_le_bytes),
            false => self.word()?.parse().ok(),
        }
    }
}
