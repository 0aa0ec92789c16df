// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** A WebSocket that opens itself again, with growing waits. */

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 8000;
const OPEN_MS = 10_000; // a connection that took longer is of a network that was gone

/**
 * @param {string} path
 * @returns {string} the address of a WebSocket of this server
 */
function address(path) {
  return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}${path}`;
}

/**
 * @typedef {object} Listeners
 * @property {() => void} [opened]
 * @property {(data: any) => void} received  text, or an ArrayBuffer
 * @property {(retryAt: number) => void} [lost]  retryAt: performance.now() of the next try
 */

export class RetryingSocket {
  /**
   * @param {string} path
   * @param {Listeners} listeners
   */
  constructor(path, listeners) {
    this.path = path;
    this.listeners = listeners;
    this.failures = 0;
    this.wanted = false;
    this.retry = () => this.wanted && !this.socket && this.connect();
    this.awake = () => document.visibilityState === "visible" && this.retry();
  }

  get open() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  start() {
    if (this.wanted) return;
    this.wanted = true;
    window.addEventListener("online", this.retry);
    document.addEventListener("visibilitychange", this.awake);
    this.connect();
  }

  stop() {
    this.wanted = false;
    clearTimeout(this.timer);
    window.removeEventListener("online", this.retry);
    document.removeEventListener("visibilitychange", this.awake);
    this.drop();
  }

  /** @param {string} text */
  send(text) {
    this.socket?.send(text);
  }

  /** Gives up a silent connection, and opens a new one. */
  restart() {
    this.drop();
    if (this.wanted) this.again();
  }

  /** Opens another connection at once, if one is wanted and does not open already. */
  renew() {
    if (!this.wanted || this.socket?.readyState === WebSocket.CONNECTING) return;
    this.drop();
    this.connect();
  }

  drop() {
    const socket = this.socket;
    this.socket = undefined;
    if (!socket) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
  }

  connect() {
    clearTimeout(this.timer);
    const socket = new WebSocket(address(this.path));
    this.socket = socket;
    socket.binaryType = "arraybuffer";
    this.timer = setTimeout(() => this.restart(), OPEN_MS);
    socket.onopen = () => {
      clearTimeout(this.timer);
      this.listeners.opened?.();
    };
    socket.onmessage = ({ data }) => {
      this.failures = 0;
      this.listeners.received(data);
    };
    socket.onclose = () => {
      this.socket = undefined;
      if (this.wanted) this.again();
    };
  }

  again() {
    const doubled = Math.min(FIRST_WAIT_MS * 2 ** this.failures, LONGEST_WAIT_MS);
    const wait = doubled * (0.8 + 0.4 * Math.random()); // many tablets must not come at once
    this.failures += 1;
    clearTimeout(this.timer);
    this.timer = setTimeout(this.retry, wait);
    this.listeners.lost?.(performance.now() + wait);
  }
}
