// Copyright 2026 The tirgeo maintainers
// SPDX-License-Identifier: Apache-2.0
/** Requests to the server and their answers, over connections that may be lost. */

import { t } from "../shell/language.js";

const ANSWER_MS = 10000; // a recording may take seconds to begin

/**
 * @typedef {{ok: boolean, reason?: string, lost?: boolean, again?: boolean}
 *   & Record<string, any>} Answer  again: the request was sent twice, so the answer may be old
 * @typedef {{message: Record<string, any>, keep: boolean, sent: boolean,
 *   again: boolean, resolve: (answer: Answer) => void, timer?: number}} Pending
 */

/** @returns {string} 16 hex digits; randomUUID is there only on https */
function randomName() {
  const bytes = crypto.getRandomValues(new Uint8Array(8));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export class Requests {
  /** @param {(text: string) => boolean} send  says whether it could be sent */
  constructor(send) {
    this.send = send;
    this.session = randomName();
    this.count = 0;
    /** @type {Map<string, Pending>} */
    this.pending = new Map();
  }

  /**
   * Sends a request and waits for its answer; it never rejects.
   *
   * With `keep` an unanswered request is sent again, under the same name, after each
   * reconnection, until it is answered. Without it, it fails with `lost`.
   * @param {string} type
   * @param {Record<string, any>} fields
   * @param {{keep?: boolean}} options
   * @returns {Promise<Answer>}
   */
  ask(type, fields = {}, { keep = false } = {}) {
    this.count += 1;
    const message = { type, request: `${this.session}-${this.count}`, ...fields };
    return new Promise((resolve) => {
      const pending = { message, keep, sent: false, again: false, resolve };
      this.pending.set(message.request, pending);
      this.dispatch(pending);
    });
  }

  /** @param {Pending} pending */
  dispatch(pending) {
    pending.sent = this.send(JSON.stringify(pending.message));
    if (pending.keep) return;
    const reason = t("link.none");
    if (!pending.sent) this.finish(pending, { ok: false, lost: true, reason });
    else {
      const none = { ok: false, lost: true, reason: t("link.no_answer") };
      pending.timer = setTimeout(() => this.finish(pending, none), ANSWER_MS);
    }
  }

  /**
   * @param {Pending} pending
   * @param {Answer} answer
   */
  finish(pending, answer) {
    clearTimeout(pending.timer);
    this.pending.delete(pending.message.request);
    pending.resolve(answer);
  }

  /** @param {any} message  of type "answer" */
  answered(message) {
    const pending = this.pending.get(message.request);
    if (pending) this.finish(pending, { ...message, again: pending.again });
  }

  /** Sends all kept requests again, in their order. */
  reconnected() {
    for (const pending of [...this.pending.values()]) this.dispatch(pending);
  }

  /** Ends the requests that must not be sent again. */
  disconnected() {
    const reason = t("link.lost");
    for (const pending of [...this.pending.values()]) {
      pending.again ||= pending.sent; // then its answer may be of that first time
      pending.sent = false;
      if (!pending.keep) this.finish(pending, { ok: false, lost: true, reason });
    }
  }

  /** @returns {boolean} whether a change is not confirmed yet */
  get unconfirmed() {
    return [...this.pending.values()].some((pending) => pending.keep);
  }
}
