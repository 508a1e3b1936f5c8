//! The picture of a run: round trips from the median to the slowest, and throughput by size.

use std::path::Path;

use anyhow::{Context, Result};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;

use super::row::{Pinning, Row, Stack};

const WIDTH: u32 = 1200;
const HEIGHT: u32 = 420;
/// Percentiles that a curve goes through, as far as a stack tells them.
const PERCENTILES: [&str; 5] = ["p50", "p90", "p99", "p99.9", "max"];
/// Where the two axes of a curve's points lie.
type Point = (f64, f64);
/// A stack and its curve.
type Curve = (Stack, Vec<Point>);

/// Draws what there is rows for; a picture of nothing is not drawn.
pub(super) fn write(path: &Path, rows: &[Row]) -> Result<()> {
    let panels = panels(rows);
    if panels.is_empty() {
        return Ok(());
    }
    let mut svg = String::new();
    {
        let count = u32::try_from(panels.len())?;
        let root = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT * count)).into_drawing_area();
        root.fill(&WHITE)?;
        for (area, panel) in root.split_evenly((panels.len(), 1)).iter().zip(&panels) {
            panel.draw(area)?;
        }
        root.present()?;
    }
    std::fs::write(path, svg).with_context(|| format!("{} cannot be written", path.display()))
}

/// One diagram.
struct Panel {
    title: String,
    horizontal: Horizontal,
    vertical: &'static str,
    curves: Vec<Curve>,
}

#[derive(Clone, Copy, Eq, PartialEq)]
enum Horizontal {
    /// The index of a percentile.
    Percentile,
    /// Bytes of a sample.
    Size,
}

fn panels(rows: &[Row]) -> Vec<Panel> {
    let latency = |(bench, pinning): (&'static str, Pinning)| Panel {
        title: format!("{bench}, 100 B, {}", pinning.name()),
        horizontal: Horizontal::Percentile,
        vertical: "round trip, us",
        curves: curves(rows, |row| {
            let is_shown = row.case.bench == bench && row.case.pinning == pinning;
            if is_shown {
                percentiles(row)
            } else {
                Vec::new()
            }
        }),
    };
    let throughput = |bench: &'static str| Panel {
        title: format!("{bench}, one writer to one reader"),
        horizontal: Horizontal::Size,
        vertical: "MB/s",
        curves: curves(rows, |row| {
            let rate = row
                .figures
                .samples_per_s
                .filter(|_| row.case.bench == bench);
            let size = row.case.size as f64;
            rate.map(|rate| (size, rate * size / 1e6))
                .into_iter()
                .collect()
        }),
    };
    let between_hosts = [Pinning::OneCpu, Pinning::TwoCpus, Pinning::Free];
    let between_hosts = between_hosts.map(|pinning| ("latency", pinning));
    let latencies = between_hosts
        .into_iter()
        .chain([("same-host", Pinning::OneCpu)]);
    let all = latencies
        .map(latency)
        .chain(["throughput", "large"].map(throughput));
    all.filter(|panel| !panel.curves.is_empty()).collect()
}

/// The curve of each stack, of the points that its rows give.
fn curves(rows: &[Row], points: impl Fn(&Row) -> Vec<Point>) -> Vec<Curve> {
    let mut curves: Vec<Curve> = Vec::new();
    for row in rows {
        let points = points(row);
        match curves
            .iter_mut()
            .find(|(stack, _)| *stack == row.case.stack)
        {
            Some((_, curve)) => curve.extend(points),
            None if points.is_empty() => {}
            None => curves.push((row.case.stack, points)),
        }
    }
    curves
}

fn percentiles(row: &Row) -> Vec<Point> {
    let figures = &row.figures;
    let values = [
        figures.p50_us,
        figures.p90_us,
        figures.p99_us,
        figures.p999_us,
        figures.max_us,
    ];
    let points = values.iter().enumerate();
    points
        .filter_map(|(index, value)| Some((index as f64, (*value)?)))
        .collect()
}

impl Panel {
    fn draw(&self, area: &DrawingArea<SVGBackend<'_>, Shift>) -> Result<()> {
        let x = self.range(|point| point.0);
        match self.horizontal {
            Horizontal::Percentile => self.draw_over(area, 0.0..(PERCENTILES.len() - 1) as f64),
            Horizontal::Size => self.draw_over(area, (x.start..x.end).log_scale()),
        }
    }

    fn draw_over<X>(&self, area: &DrawingArea<SVGBackend<'_>, Shift>, x: X) -> Result<()>
    where
        X: AsRangedCoord<Value = f64>,
        X::CoordDescType: ValueFormatter<f64>,
    {
        let y = self.range(|point| point.1);
        let mut chart = ChartBuilder::on(area)
            .caption(&self.title, ("sans-serif", 20))
            .margin(12)
            .x_label_area_size(36)
            .y_label_area_size(80)
            .build_cartesian_2d(x, (y.start..y.end).log_scale())?;
        chart
            .configure_mesh()
            .x_labels(PERCENTILES.len())
            .x_label_formatter(&|x| self.label(*x))
            .y_desc(self.vertical)
            .light_line_style(WHITE)
            .draw()?;
        for (stack, points) in &self.curves {
            let color = color(*stack);
            let line = LineSeries::new(points.iter().copied(), color.stroke_width(2));
            let legend =
                move |(x, y)| PathElement::new([(x, y), (x + 20, y)], color.stroke_width(2));
            chart
                .draw_series(line.point_size(3))?
                .label(stack.name())
                .legend(legend);
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperLeft)
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK.mix(0.3))
            .draw()?;
        Ok(())
    }

    /// From the least to the greatest, with some room.
    fn range(&self, of: fn(&Point) -> f64) -> std::ops::Range<f64> {
        let values = || self.curves.iter().flat_map(|(_, points)| points).map(of);
        let least = values().fold(f64::INFINITY, f64::min);
        let greatest = values().fold(0.0, f64::max);
        least / 1.3..greatest * 1.3
    }

    fn label(&self, x: f64) -> String {
        match self.horizontal {
            Horizontal::Percentile => {
                let name = PERCENTILES
                    .get(x.round() as usize)
                    .filter(|_| x.fract() == 0.0);
                name.map_or_else(String::new, |name| (*name).to_owned())
            }
            Horizontal::Size if x >= 1024.0 * 1024.0 => format!("{:.0} MB", x / 1024.0 / 1024.0),
            Horizontal::Size if x >= 1024.0 => format!("{:.0} kB", x / 1024.0),
            Horizontal::Size => format!("{x:.0} B"),
        }
    }
}

/// The same in all diagrams; ours are strong.
fn color(stack: Stack) -> RGBColor {
    match stack {
        Stack::Kernel => RGBColor(214, 39, 40),
        Stack::KernelSpin => RGBColor(255, 127, 14),
        Stack::InProcess => RGBColor(227, 119, 194),
        Stack::Udp => RGBColor(127, 127, 127),
        Stack::UdpSpin => RGBColor(190, 190, 190),
        Stack::Cyclone => RGBColor(31, 119, 180),
        Stack::Fastdds => RGBColor(44, 160, 44),
        Stack::Rustdds => RGBColor(148, 103, 189),
    }
}

#[cfg(test)]
mod tests {
    use super::super::figures::Figures;
    use super::super::row::Case;
    use super::*;

    fn row(bench: &'static str, stack: Stack, size: usize, figures: Figures) -> Row {
        let case = Case {
            bench,
            stack,
            size,
            pinning: Pinning::Free,
            readers: 1,
        };
        Row { case, figures }
    }

    #[test]
    fn a_curve_leaves_out_what_was_not_told() {
        let figures = Figures {
            p50_us: Some(5.0),
            max_us: Some(9.0),
            ..Figures::default()
        };
        let panels = panels(&[row("latency", Stack::Cyclone, 100, figures)]);
        assert_eq!(panels.len(), 1);
        assert_eq!(
            panels[0].curves,
            [(Stack::Cyclone, vec![(0.0, 5.0), (4.0, 9.0)])]
        );
    }

    #[test]
    fn a_stack_has_one_curve_and_the_picture_its_name() {
        let rate = |rate| Figures {
            samples_per_s: Some(rate),
            ..Figures::default()
        };
        let rows = [
            row("throughput", Stack::Kernel, 100, rate(1e6)),
            row("throughput", Stack::Kernel, 1024, rate(5e5)),
        ];
        assert_eq!(
            panels(&rows)[0].curves,
            [(Stack::Kernel, vec![(100.0, 100.0), (1024.0, 512.0)])]
        );
        let path = std::env::temp_dir().join(format!("bench-{}.svg", std::process::id()));
        write(&path, &rows).unwrap();
        let svg = std::fs::read_to_string(&path).unwrap();
        std::fs::remove_file(path).unwrap();
        assert!(svg.contains("throughput, one writer to one reader") && svg.contains("kernel"));
    }
}
