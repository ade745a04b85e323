/** How many of the times fall into each of equal parts of an interval. */
export function histogram(times: readonly number[], start: number, end: number, bins: number): number[] {
  const counts = new Array<number>(bins).fill(0);
  for (const time of times) {
    const bin = Math.floor(((time - start) / (end - start)) * bins);
    const row = Math.min(Math.max(bin, 0), bins - 1);
    counts[row] = (counts[row] ?? 0) + 1;
  }
  return counts;
}
