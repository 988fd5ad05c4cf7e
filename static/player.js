/* Playing what a walker would hear: the console's sounds where it makes some, else the browser's own voice. */

const PAUSE_MS = 350;

export class Player {
  /** `show(index)` hears what is played now, and null at the end. */
  constructor(show) {
    this.show = show;
    this.run = 0;
    this.audio = null;
    this.source = null;
  }

  /** Play [index, utterance] one after the other; what was played before ends. */
  async play(queue, language) {
    this.stop();
    const run = ++this.run;
    for (const [index, { text, sound }] of queue) {
      if (!text && !sound) continue;
      this.show(index);
      const heard = sound ? await this.playSound(sound) : false;
      if (run !== this.run) return;
      if (!heard && text) await speak(text, language);
      if (run !== this.run) return;
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
    }
    if (run === this.run) this.show(null);
  }

  stop() {
    this.run += 1;
    this.source?.stop();
    this.source = null;
    speechSynthesis?.cancel();
    this.show(null);
  }

  /** Play a sound of the console; false where it could not be had. */
  async playSound(path) {
    try {
      this.audio ??= new AudioContext();
      const answer = await fetch(path);
      if (!answer.ok) return false;
      const source = this.audio.createBufferSource();
      source.buffer = await this.audio.decodeAudioData(await answer.arrayBuffer());
      source.connect(this.audio.destination);
      this.source = source;
      await new Promise((resolve) => { source.onended = resolve; source.start(); });
      return true;
    } catch {
      return false;
    }
  }
}

function speak(text, language) {
  if (!("speechSynthesis" in globalThis)) return Promise.resolve();
  const words = new SpeechSynthesisUtterance(text);
  words.lang = language === "zh" ? "zh-CN" : "en-GB";
  return new Promise((resolve) => {
    words.onend = words.onerror = resolve;
    speechSynthesis.speak(words);
  });
}
