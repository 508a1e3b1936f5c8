//! The rows for people, and for programs.

use anyhow::Result;

use super::row::Row;

/// A table for each benchmark, or a JSON array as the last line.
pub(super) fn print(rows: &[Row], json: bool) -> Result<()> {
    if json {
        println!("{}", serde_json::to_string(rows)?);
        return Ok(());
    }
    let mut rest = rows;
    while let Some(first) = rest.first() {
        let bench = first.case.bench;
        let count = rest
            .iter()
            .take_while(|row| row.case.bench == bench)
            .count();
        let (table, others) = rest.split_at(count);
        println!("{}", text(bench, table));
        rest = others;
    }
    Ok(())
}

/// A column: its head, its width, and the cell of a row.
type Column = (&'static str, usize, fn(&Row) -> Option<String>);

const COLUMNS: [Column; 12] = [
    ("p50 us", 9, |row| decimal(row.figures.p50_us, 1)),
    ("p90 us", 9, |row| decimal(row.figures.p90_us, 1)),
    ("p99 us", 9, |row| decimal(row.figures.p99_us, 1)),
    ("p99.9 us", 9, |row| decimal(row.figures.p999_us, 1)),
    ("max us", 9, |row| decimal(row.figures.max_us, 1)),
    ("samples/s", 11, |row| decimal(row.figures.samples_per_s, 0)),
    ("lost", 7, |row| {
        row.figures.lost.map(|lost| lost.to_string())
    }),
    ("CPU ns", 10, |row| {
        decimal(row.figures.cpu_ns_per_sample, 0)
    }),
    ("switches", 9, |row| {
        decimal(row.figures.switches_per_sample, 3)
    }),
    ("calls", 8, |row| {
        decimal(row.figures.syscalls_per_sample, 3)
    }),
    ("wakes/s", 8, |row| decimal(row.figures.wakeups_per_s, 1)),
    ("RSS kB", 8, |row| {
        row.figures.rss_kb.map(|rss_kb| rss_kb.to_string())
    }),
];

/// Columns that no row fills are left out.
fn text(bench: &str, rows: &[Row]) -> String {
    let columns = COLUMNS.iter();
    let columns: Vec<&Column> = columns
        .filter(|(_, _, cell)| rows.iter().any(|row| cell(row).is_some()))
        .collect();
    let mut text = format!(
        "{bench}\n{:<12} {:>9} {:<9} {:>2}",
        "stack", "size", "pinning", "R"
    );
    for (head, width, _) in &columns {
        text += &format!(" {head:>width$}");
    }
    text.push('\n');
    for row in rows {
        let case = &row.case;
        let [stack, pinning] = [case.stack.name(), case.pinning.name()];
        text += &format!(
            "{stack:<12} {:>9} {pinning:<9} {:>2}",
            case.size, case.readers
        );
        for (_, width, cell) in &columns {
            text += &format!(" {:>width$}", cell(row).unwrap_or_default());
        }
        text.push('\n');
    }
    text
}

fn decimal(figure: Option<f64>, digits: usize) -> Option<String> {
    figure.map(|figure| format!("{figure:.digits$}"))
}
