// The page's data: base64 of a deflate stream of (header size, header JSON, byte planes); see lavsim/viewer/pack.py.

function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function integrate(values, lengths) {
  let at = 0;
  for (const length of lengths) {
    let sum = 0;
    for (const end = at + length; at < end; at++) values[at] = sum = (sum + values[at]) | 0;
  }
}

function numbers(body, entry, arrays) {
  const { offset, count, planes } = entry;
  const values = new Int32Array(count);
  for (let plane = 0; plane < planes; plane++) {
    const from = offset + plane * count;
    const shift = 8 * plane;
    for (let i = 0; i < count; i++) values[i] |= body[from + i] << shift;
  }
  for (let i = 0; i < count; i++) values[i] = (values[i] >>> 1) ^ -(values[i] & 1);
  const lengths = entry.groups ? arrays[entry.groups] : [count];
  for (let order = 0; order < entry.order; order++) integrate(values, lengths);
  return values;
}

/** {meta, arrays} of the text that `Pack.encode` made. */
export async function decode(text) {
  const whole = await inflated(bytesOf(text.trim()));
  const size = new DataView(whole.buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(whole.subarray(4, 4 + size)));
  const body = whole.subarray(4 + size);
  const arrays = {};
  for (const [name, entry] of Object.entries(header.arrays)) {
    arrays[name] = entry.raw ? body.slice(entry.offset, entry.offset + entry.count) : numbers(body, entry, arrays);
  }
  return { meta: header.meta, arrays };
}
