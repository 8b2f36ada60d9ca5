/** The inverse of `simspec/report/page/packing.py`. */

import type { PageData } from "./data";

/** Bytes of a packed entry: base64, gzip. */
export async function bytes(page: PageData, name: string): Promise<Uint8Array<ArrayBuffer>> {
  const packed = page.packed[name];
  if (packed === undefined) throw new Error(`the page has no data ${name}`);
  const zipped = Uint8Array.from(atob(packed), (character) => character.charCodeAt(0));
  const stream = new Blob([zipped]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** 16-bit numbers whose low bytes stand before all high bytes. */
function joined(planes: Uint8Array): Int16Array {
  const count = planes.length / 2;
  const values = new Int16Array(count);
  for (let i = 0; i < count; i++) values[i] = planes[i] | (planes[count + i] << 8);
  return values;
}

/** Series of `frames` numbers each, one after the other, packed as differences in time. */
export async function series(page: PageData, name: string, frames: number): Promise<Int16Array> {
  const values = joined(await bytes(page, name));
  for (let start = 0; start < values.length; start += frames)
    for (let frame = 1; frame < frames; frame++) values[start + frame] += values[start + frame - 1];
  return values;
}

export async function int16(page: PageData, name: string): Promise<Int16Array> {
  return joined(await bytes(page, name));
}

export async function uint16(page: PageData, name: string): Promise<Uint16Array> {
  return new Uint16Array(joined(await bytes(page, name)).buffer);
}

export async function float32(page: PageData, name: string): Promise<Float32Array> {
  return new Float32Array((await bytes(page, name)).buffer);
}

/** What a 16-bit number stands for between `low` and `high`. */
export function unpacked(value: number, low: number, high: number): number {
  return low + ((value + 32767) / 65534) * (high - low);
}
