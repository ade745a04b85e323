/** The service's time, which ages are counted from. */

/** A clock that is further off than this is not wrong: it stands still while drives of another day are replayed. */
const MOST_SKEW_S = 300;

export class ServiceClock {
  private offset = 0;
  private standing: number | null = null;

  constructor(private readonly wall: () => number = () => Date.now() / 1000) {}

  /** Seconds since the epoch (UTC). */
  readonly now = (): number => this.standing ?? this.wall() + this.offset;

  /** Set by what the service said just now. */
  settle(serviceNow: number | null): void {
    if (serviceNow === null) return;
    const skew = serviceNow - this.wall();
    const runs = Math.abs(skew) < MOST_SKEW_S;
    this.offset = runs ? skew : 0;
    this.standing = runs ? null : serviceNow;
  }

  /** Something was observed at this time: a clock that stands is at least there. */
  reach(observedAt: number): void {
    if (this.standing !== null) this.standing = Math.max(this.standing, observedAt);
  }
}
