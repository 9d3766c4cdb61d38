//! What was delivered, as `play` prints it.

use bagpipe_replay::Replayed;

/// A line for each topic, subscriber and step, and what the user should know.
pub fn table(replayed: &Replayed) -> String {
    let ledger = &replayed.ledger;
    let mut lines = vec![format!(
        "{} messages in {:.3} s, {} received by every subscriber, {} dropped",
        ledger.sent, replayed.playback.played_seconds, ledger.received, ledger.dropped
    )];
    for topic in &ledger.topics {
        lines.push(format!("{}  {} sent", topic.topic, topic.sent));
        for line in &topic.subscribers {
            let (node, received, dropped) = (&line.node, line.received, line.dropped);
            let proof = line.strength.name();
            lines.push(format!("  {node}  {received} received, {dropped} dropped ({proof})"));
        }
        if topic.subscribers.is_empty() {
            lines.push("  nobody subscribed".to_owned());
        }
    }
    for step in &replayed.playback.steps {
        lines.push(format!(
            "{} -> {}  {} answered, {} without output, {} skipped",
            step.triggers.join(" + "),
            step.answer,
            step.answered,
            step.no_output,
            step.skipped
        ));
    }
    lines.extend(replayed.playback.warnings.iter().cloned());
    lines.extend(replayed.playback.pace.clone());
    lines.join("\n") + "\n"
}
