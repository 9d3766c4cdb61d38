//! Which processes a process has started, and those have.

use std::collections::{BTreeMap, BTreeSet};

/// Every process below `root`, without `spared` and what is below those.
pub fn descendants(root: u32, spared: &BTreeSet<i32>) -> BTreeSet<i32> {
    let mut children: BTreeMap<i32, Vec<i32>> = BTreeMap::new();
    for (pid, parent) in all_processes() {
        children.entry(parent).or_default().push(pid);
    }
    let mut found = BTreeSet::new();
    let mut unseen = vec![i32::try_from(root).unwrap_or(0)];
    while let Some(parent) = unseen.pop() {
        for pid in children.get(&parent).into_iter().flatten() {
            if !spared.contains(pid) && found.insert(*pid) {
                unseen.push(*pid);
            }
        }
    }
    found
}

/// (pid, parent) of every process that /proc shows.
fn all_processes() -> Vec<(i32, i32)> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    entries
        .filter_map(|entry| {
            let pid: i32 = entry.file_name().to_str()?.parse().ok()?;
            let stat = std::fs::read(entry.path().join("stat")).ok()?;
            // The command's name stands in parentheses and may hold anything.
            let after = stat.iter().rposition(|byte| *byte == b')')?;
            let text = String::from_utf8_lossy(&stat[after + 1..]).into_owned();
            let parent = text.split_whitespace().nth(1)?.parse().ok()?;
            Some((pid, parent))
        })
        .collect()
}
