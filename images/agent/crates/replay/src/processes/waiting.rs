//! How long each node's threads could have run and had no processor: what a busy machine can
//! have cost it. A thread that ended meanwhile excuses nothing.

use std::collections::BTreeMap;

use super::{demand, tasks};

/// The time that a thread has waited for a processor since it began, in nanoseconds, by thread.
type Waited = BTreeMap<i32, u64>;

/// The nodes' waits from a moment on.
pub(crate) struct Waiting {
    before: BTreeMap<String, (i32, Waited)>,
}

impl Waiting {
    /// Begins to count for nodes, of each of which the process is known.
    pub(crate) fn begin(pids: &BTreeMap<String, i32>) -> Waiting {
        let before = pids.iter().map(|(node, &pid)| (node.clone(), (pid, waited(pid)))).collect();
        Waiting { before }
    }

    /// Seconds since then by node, summed over its threads; without those nodes of which the
    /// kernel says nothing.
    pub(crate) fn seconds(&self) -> BTreeMap<String, f64> {
        let grown = |(node, (pid, before)): (&String, &(i32, Waited))| {
            let now = waited(*pid);
            (!now.is_empty()).then(|| (node.clone(), grown(before, &now)))
        };
        self.before.iter().filter_map(grown).collect()
    }
}

fn waited(pid: i32) -> Waited {
    let number = |task: &std::path::Path| task.file_name()?.to_str()?.parse().ok();
    let read = |task: std::path::PathBuf| Some((number(&task)?, demand(&task)?.waited));
    tasks(pid).into_iter().filter_map(read).collect()
}

fn grown(before: &Waited, now: &Waited) -> f64 {
    let of = |(thread, waited): (&i32, &u64)| {
        waited.saturating_sub(before.get(thread).copied().unwrap_or_default())
    };
    now.iter().map(of).sum::<u64>() as f64 / 1e9
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_threads_waited_before_or_have_taken_along_does_not_count() {
        let before = Waited::from([(1, 500), (2, 7_000_000_000)]);
        let now = Waited::from([(1, 1_000_000_500), (3, 250_000_000)]);
        assert!((grown(&before, &now) - 1.25).abs() < 1e-9);
        assert_eq!(grown(&now, &now), 0.0);
    }

    #[test]
    fn a_node_that_is_gone_has_no_figure() {
        let ours = i32::try_from(std::process::id()).unwrap();
        let pids = BTreeMap::from([("/here".to_owned(), ours), ("/gone".to_owned(), 0)]);
        let seconds = Waiting::begin(&pids).seconds();
        assert_eq!(seconds.keys().collect::<Vec<_>>(), ["/here"]);
    }
}
