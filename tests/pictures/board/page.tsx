// A dashboard's JSON and what a Prometheus answered to its panels, drawn by Grafana's own components.
// The page has `BOARD`, the JSON, `ANSWERS`, and `MODE`, light or dark.
import {
  createTheme, dateTime, FieldType, getDisplayProcessor, getFieldDisplayValues, ThemeContext, toDataFrame,
  type DataFrame, type FieldDisplay,
} from '@grafana/data';
import {
  BarGauge, BigValue, BigValueColorMode, BigValueGraphMode, BigValueJustifyMode, GlobalStyles, LegendDisplayMode,
  PanelChrome, TimeSeries,
} from '@grafana/ui';
import { createRoot } from 'react-dom/client';

// Pixels of a row of the grid, between panels, and columns: Grafana's.
const ROW = 30, GAP = 8, COLUMNS = 24;

type Series = { name: string; times: number[]; values: Array<number | null> };
type Answers = { from: number; to: number; panels: Record<string, Series[]> };
type Size = { width: number; height: number };
type Shown = Size & { panel: any; answers: Answers };

declare global {
  interface Window { BOARD: any; ANSWERS: Answers; MODE: 'light' | 'dark' }
}

const theme = createTheme({ colors: { mode: window.MODE } });

// What Grafana fills in where a panel says nothing.
function settings(panel: any, name: string) {
  const { custom = {}, links: _, ...given } = panel.fieldConfig?.defaults ?? {};
  const lines = panel.type === 'timeseries';
  return {
    thresholds: { mode: 'absolute', steps: [{ value: -Infinity, color: 'green' }] },
    color: { mode: lines ? 'palette-classic' : 'thresholds' },
    ...given,
    displayName: name,
    custom: { drawStyle: 'line', lineWidth: 1, showPoints: 'auto', pointSize: 5, ...custom },
  } as any;
}

function frames(panel: any, series: Series[]): DataFrame[] {
  return series.map((one, seriesIndex) => {
    const frame = toDataFrame({
      name: one.name,
      fields: [
        { name: 'Time', type: FieldType.time, values: one.times, config: {} },
        { name: one.name, type: FieldType.number, values: one.values, config: settings(panel, one.name) },
      ],
    });
    for (const field of frame.fields) {
      field.state = { seriesIndex, displayName: field.config.displayName };
      field.display = getDisplayProcessor({ field, theme, timeZone: 'utc' });
    }
    return frame;
  });
}

function Lines({ panel, answers, width, height, series }: Shown & { series: Series[] }) {
  const from = dateTime(answers.from), to = dateTime(answers.to);
  const legend = { showLegend: true, displayMode: LegendDisplayMode.List, placement: 'bottom' as const, calcs: [] };
  return (
    <TimeSeries frames={frames(panel, series)} width={width} height={height} timeZone="utc" legend={legend}
      timeRange={{ from, to, raw: { from, to } }} />
  );
}

function Numbers({ values, width, height }: Size & { values: FieldDisplay[] }) {
  const each = width / values.length;
  return (
    <div style={{ display: 'flex' }}>
      {values.map((value, at) => (
        <BigValue key={at} width={each} height={height} value={value.display} theme={theme} count={values.length}
          colorMode={BigValueColorMode.Value} graphMode={BigValueGraphMode.None}
          justifyMode={BigValueJustifyMode.Auto} />
      ))}
    </div>
  );
}

function Bars({ values, width, height, panel }: Size & { values: FieldDisplay[]; panel: any }) {
  const each = Math.min(40, height / values.length), most = Math.max(...values.map((value) => value.display.numeric));
  return (
    <div>
      {values.map((value, at) => (
        <BarGauge key={at} width={width} height={each - 4} value={value.display} theme={theme} text={{ titleSize: 14 }}
          field={{ min: 0, max: most || 1, ...value.field }} orientation={panel.options.orientation}
          displayMode={panel.options.displayMode} />
      ))}
    </div>
  );
}

function Drawn(shown: Shown & { at: number }) {
  const { panel, answers, width, height, at } = shown;
  const series = answers.panels[String(at)] ?? [];
  if (series.length === 0) {
    return <div style={{ textAlign: 'center', paddingTop: height / 2 - 10 }}>No data</div>;
  }
  if (panel.type === 'timeseries') {
    return <Lines {...shown} series={series} />;
  }
  const values = getFieldDisplayValues({
    fieldConfig: { defaults: {}, overrides: [] }, reduceOptions: { calcs: ['lastNotNull'] }, theme, timeZone: 'utc',
    replaceVariables: (text: string) => text, data: frames(panel, series),
  });
  return panel.type === 'stat'
    ? <Numbers values={values} width={width} height={height} />
    : <Bars values={values} width={width} height={height} panel={panel} />;
}

function Placed({ panel, at }: { panel: any; at: number }) {
  const { x, y, w, h } = panel.gridPos, column = (window.innerWidth - 2 * GAP) / COLUMNS;
  const style = { position: 'absolute' as const, left: GAP + x * column, top: y * ROW, margin: 0 };
  if (panel.type === 'row') {
    return <h4 style={style}>{panel.title}</h4>;
  }
  return (
    <div style={style} className="panel">
      <PanelChrome title={panel.title} width={w * column - GAP} height={h * ROW - GAP}>
        {(width, height) => <Drawn panel={panel} at={at} answers={window.ANSWERS} width={width} height={height} />}
      </PanelChrome>
    </div>
  );
}

function Board() {
  const panels: any[] = window.BOARD.panels;
  const rows = Math.max(...panels.map(({ gridPos }) => gridPos.y + gridPos.h));
  return (
    <ThemeContext.Provider value={theme}>
      <GlobalStyles />
      <h3 style={{ margin: GAP }}>{window.BOARD.title}</h3>
      <div style={{ position: 'relative', height: rows * ROW + GAP }}>
        {panels.map((panel, at) => <Placed key={at} panel={panel} at={at} />)}
      </div>
    </ThemeContext.Provider>
  );
}

createRoot(document.getElementById('root')!).render(<Board />);
