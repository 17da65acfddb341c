// What is held down, on the keyboard or on the pad of a touch screen, as the command that drives.

const HELD = { w: "throttle", ArrowUp: "throttle", s: "brake", ArrowDown: "brake", a: "left", ArrowLeft: "left", d: "right", ArrowRight: "right" };

export class Keys {
  /** `drive({throttle, brake, steer})` is called whenever that changes. */
  constructor(drive) {
    this.drive = drive;
    this.held = new Map(); // what holds it down: what it does
    this.told = "";
    window.addEventListener("blur", () => this.release());
    document.addEventListener("visibilitychange", () => document.hidden && this.release());
    for (const button of document.querySelectorAll("#pad button")) this.listen(button);
  }

  listen(button) {
    button.addEventListener("pointerdown", (event) => {
      button.setPointerCapture(event.pointerId);
      button.classList.add("held");
      this.hold(`pointer ${event.pointerId}`, button.dataset.hold);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      button.addEventListener(name, (event) => {
        button.classList.remove("held");
        this.let(`pointer ${event.pointerId}`);
      });
    }
    button.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /** Takes a key event; true if the key drives. */
  take(key, isDown) {
    const what = HELD[key.length === 1 ? key.toLowerCase() : key];
    if (!what) return false;
    if (isDown) this.hold(`key ${what} ${key.toLowerCase()}`, what);
    else this.let(`key ${what} ${key.toLowerCase()}`);
    return true;
  }

  hold(holder, what) {
    this.held.set(holder, what);
    this.tell();
  }

  let(holder) {
    if (this.held.delete(holder)) this.tell();
  }

  release() {
    this.held.clear();
    this.tell();
  }

  tell() {
    const is = new Set(this.held.values());
    const wish = { throttle: Number(is.has("throttle")), brake: Number(is.has("brake")), steer: Number(is.has("right")) - Number(is.has("left")) };
    const text = JSON.stringify(wish);
    if (text === this.told || (!this.told && !this.held.size)) return;
    this.told = text;
    this.drive(wish);
  }
}
