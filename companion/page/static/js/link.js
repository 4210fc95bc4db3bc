// The WebSocket to the page's server: connects, connects again, and knows since when nothing was heard.

const AGAIN_MS = [300, 600, 1200, 2000];
/** A connection that says nothing for so long is given up; its beat comes four times a second. */
const GIVE_UP_MS = 4000;

export class Link {
  /**
   * @param {string} url
   * @param {(message: any) => void} onMessage
   * @param {(open: boolean) => void} onChange
   */
  constructor(url, onMessage, onChange) {
    this.url = url;
    this.onMessage = onMessage;
    this.onChange = onChange;
    /** Time of the last message, ms of performance.now(). */
    this.heardMs = performance.now();
    this.startedMs = performance.now();
    this.tries = 0;
    /** @type {WebSocket | null} */
    this.socket = null;
    setInterval(() => this.watch(), 500);
  }

  /** True while messages can be sent. */
  get open() {
    return this.socket !== null && this.socket.readyState === WebSocket.OPEN;
  }

  /** Open the connection; it is opened again until `restart` or the end of the page. */
  connect() {
    const socket = new WebSocket(this.url);
    this.socket = socket;
    this.startedMs = performance.now();
    socket.addEventListener("open", () => {
      if (socket !== this.socket) return;
      this.tries = 0;
      this.onChange(true);
    });
    socket.addEventListener("message", (event) => {
      if (socket === this.socket) this.take(event.data);
    });
    socket.addEventListener("close", () => {
      if (socket === this.socket) this.lose();
    });
  }

  /** Drop the connection and open a new one at once, as after a login. */
  restart() {
    const old = this.socket;
    this.socket = null;
    this.onChange(false);
    if (old !== null) old.close();
    this.connect();
  }

  /**
   * Send a message; false if there is no connection.
   * @param {object} message
   */
  send(message) {
    if (!this.open) return false;
    /** @type {WebSocket} */ (this.socket).send(JSON.stringify(message));
    return true;
  }

  /** @param {string} data */
  take(data) {
    let message;
    try {
      message = JSON.parse(data);
    } catch {
      return; // not from our server
    }
    this.heardMs = performance.now();
    this.onMessage(message);
  }

  lose() {
    this.socket = null;
    this.onChange(false);
    const waitMs = AGAIN_MS[Math.min(this.tries, AGAIN_MS.length - 1)];
    this.tries += 1;
    setTimeout(() => {
      if (this.socket === null) this.connect();
    }, waitMs * (0.8 + 0.4 * Math.random()));
  }

  /** Give up a connection that is open, or opens, and says nothing: a server's computer that lost its power. */
  watch() {
    const since = Math.max(this.heardMs, this.startedMs);
    if (this.socket === null || performance.now() - since < GIVE_UP_MS) return;
    const old = this.socket;
    this.lose();
    old.close();
  }
}
