//! Files of SQLite whose trees lead to the same page again and again: ten levels of pages, each of
//! which names the next one 400 times. SQLite takes them for a table of 400^10 rows.

use std::path::Path;

use rusqlite::Connection;

const PAGE: usize = 4096;
const FAN: usize = 400;
const LEVELS: usize = 10;
/// Bytes of the file's own head on its first page.
const HEAD: usize = 100;
const LEAF: u8 = 13;
const INTERIOR: u8 = 5;

/// The rows of that table, over and over.
pub fn in_table(path: &Path, table: &str) {
    let root = root_of(path, table);
    let mut file = std::fs::read(path).unwrap();
    let leaf = page(&file, root).to_vec();
    let top = circle(&mut file, leaf);
    let all = interior(top, 0);
    file[(root - 1) * PAGE..root * PAGE].copy_from_slice(&all);
    write(path, file);
}

/// The rows of the schema behind the schema itself: of an index, which SQLite takes again each time.
pub fn in_schema(path: &Path) {
    Connection::open(path).unwrap().execute_batch("CREATE TABLE t(x UNIQUE)").unwrap();
    let mut file = std::fs::read(path).unwrap();
    let first = page(&file, 1).to_vec();
    assert_eq!(first[HEAD], LEAF);
    let count = usize::from(u16_at(&first, HEAD + 3));
    let cells: Vec<u16> = (0..count).map(|at| u16_at(&first, HEAD + 8 + 2 * at)).collect();
    let index = |cell: &&u16| {
        let cell = usize::from(**cell);
        String::from_utf8_lossy(&first[cell..cell + 30]).contains("autoindex")
    };
    let of_index = *cells.iter().find(index).unwrap();
    let all = leaf_of(&first, &cells);
    let all = append(&mut file, &all);
    let again = leaf_of(&first, &[of_index]);
    let top = circle(&mut file, again);
    let mut root = interior(all, HEAD);
    put_u32(&mut root, HEAD + 8, top);
    put_u16(&mut root, HEAD + 3, 1);
    root[..HEAD].copy_from_slice(&first[..HEAD]);
    file[..PAGE].copy_from_slice(&root);
    write(path, file);
}

fn root_of(path: &Path, table: &str) -> usize {
    let file = Connection::open(path).unwrap();
    let query = "SELECT rootpage FROM sqlite_schema WHERE name = ?1";
    let root: i64 = file.query_row(query, [table], |row| row.get(0)).unwrap();
    root as usize
}

/// Adds the levels above a leaf; returns the page of the last one.
fn circle(file: &mut Vec<u8>, leaf: Vec<u8>) -> u32 {
    let mut below = append(file, &leaf);
    for _ in 0..LEVELS {
        below = append(file, &interior(below, 0));
    }
    below
}

fn append(file: &mut Vec<u8>, page: &[u8]) -> u32 {
    file.extend_from_slice(page);
    (file.len() / PAGE) as u32
}

/// A page all of whose cells name the same page below.
fn interior(below: u32, at: usize) -> Vec<u8> {
    let (mut page, cell) = (vec![0; PAGE], PAGE - 5);
    page[at] = INTERIOR;
    put_u16(&mut page, at + 3, FAN as u16);
    put_u16(&mut page, at + 5, cell as u16);
    put_u32(&mut page, at + 8, below);
    put_u32(&mut page, cell, below);
    page[cell + 4] = 1;
    (0..FAN).for_each(|each| put_u16(&mut page, at + 12 + 2 * each, cell as u16));
    page
}

/// Some cells of the first page on a page of their own, where they lie as they did.
fn leaf_of(first: &[u8], cells: &[u16]) -> Vec<u8> {
    let lowest = u16_at(first, HEAD + 5);
    let mut page = vec![0; PAGE];
    page[usize::from(lowest)..].copy_from_slice(&first[usize::from(lowest)..]);
    page[0] = LEAF;
    put_u16(&mut page, 3, cells.len() as u16);
    put_u16(&mut page, 5, lowest);
    cells.iter().enumerate().for_each(|(at, cell)| put_u16(&mut page, 8 + 2 * at, *cell));
    page
}

fn write(path: &Path, mut file: Vec<u8>) {
    let pages = (file.len() / PAGE) as u32;
    put_u32(&mut file, 28, pages);
    std::fs::write(path, file).unwrap();
}

fn page(file: &[u8], number: usize) -> &[u8] {
    &file[(number - 1) * PAGE..number * PAGE]
}

fn u16_at(page: &[u8], at: usize) -> u16 {
    u16::from_be_bytes([page[at], page[at + 1]])
}

fn put_u16(page: &mut [u8], at: usize, value: u16) {
    page[at..at + 2].copy_from_slice(&value.to_be_bytes());
}

fn put_u32(page: &mut [u8], at: usize, value: u32) {
    page[at..at + 4].copy_from_slice(&value.to_be_bytes());
}
