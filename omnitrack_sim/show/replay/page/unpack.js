// Tables of numbers back from the text that packing.py makes of them.

/** The bytes of all tables. */
export async function unpacked(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The columns of a table, each a Float64Array; what is a gap is NaN. */
export function columnsOf(bytes, table) {
  const columns = [];
  for (let column = 0; column < table.columns; column++) {
    const start = table.at + column * table.rows * table.bytes;
    columns.push(scaled(wholeNumbers(bytes, start, table), table, column));
  }
  return columns;
}

function wholeNumbers(bytes, start, { rows, bytes: width }) {
  const values = new Float64Array(rows);
  for (let place = width - 1; place >= 0; place--) {
    const from = start + place * rows;
    for (let row = 0; row < rows; row++) values[row] = 256 * values[row] + bytes[from + row];
  }
  let value = 0;
  for (let row = 0; row < rows; row++) {
    const coded = values[row];
    value += coded % 2 ? -(coded + 1) / 2 : coded / 2;
    values[row] = value;
  }
  return values;
}

function scaled(values, table, column) {
  const step = table.steps?.[column] ?? table.step ?? 1;
  const low = table.low?.[column] ?? 0;
  for (let row = 0; row < values.length; row++) {
    values[row] = values[row] === table.gap ? NaN : low + step * values[row];
  }
  return values;
}

/** The rows of a table one after the other, as an array of the given kind. */
export function flattened(bytes, table, Kind) {
  const columns = columnsOf(bytes, table);
  const flat = new Kind(table.rows * table.columns);
  columns.forEach((values, column) => {
    for (let row = 0; row < table.rows; row++) flat[row * table.columns + column] = values[row];
  });
  return flat;
}
