"""A page in headless Chromium over its debugging protocol: what it logs, receives and shows."""

import asyncio
import base64
import contextlib
import json
import re
import subprocess

import aiohttp

COMPLAINTS = ("error", "warning", "assert")


class Page:
    """A page that is open; `complaints` are lines of its console and requests that failed."""

    def __init__(self, socket):
        self.socket, self.number, self.answers = socket, 0, {}
        self.complaints, self.requests, self.frames = [], [], []

    async def call(self, method, **parameters):
        self.number += 1
        self.answers[self.number] = asyncio.get_running_loop().create_future()
        message = {"id": self.number, "method": method, "params": parameters}
        await self.socket.send_json(message)
        return await asyncio.wait_for(self.answers[self.number], 30)

    async def listen(self):
        async for message in self.socket:
            said = json.loads(message.data)
            if "id" in said:
                answer = self.answers[said["id"]]
                if "error" in said:
                    answer.set_exception(RuntimeError(said["error"]["message"]))
                else:
                    answer.set_result(said["result"])
                continue
            method, about = said["method"], said["params"]
            if method == "Runtime.consoleAPICalled" and about["type"] in COMPLAINTS:
                self.complaints.append(" ".join(str(a.get("value")) for a in about["args"]))
            elif method == "Runtime.exceptionThrown":
                details = about["exceptionDetails"]
                thrown = details.get("exception", {}).get("description", "")
                self.complaints.append(f"{details['text']} {thrown} {details.get('url', '')}")
            elif method == "Log.entryAdded" and about["entry"]["level"] in COMPLAINTS:
                self.complaints.append(about["entry"]["text"])
            elif method == "Network.requestWillBeSent":
                self.requests.append(about["request"]["url"])
            elif method == "Network.webSocketFrameReceived":
                self.frames.append(about["response"]["payloadData"])

    async def value(self, script):
        """The value of an expression, or what its promise resolves to."""
        done = await self.call(
            "Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in done, done
        return done["result"].get("value")

    async def press(self, key):
        for kind in ("keyDown", "keyUp"):
            await self.call("Input.dispatchKeyEvent", type=kind, key=key, text=key)

    async def picture(self, path, whole=False):
        done = await self.call("Page.captureScreenshot", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(done["data"]))

    def received(self):
        """What WebSockets received, as one text: binary frames without escape sequences."""
        text = "".join(
            base64.b64decode(f).decode("utf-8", "replace") if not f.startswith("[") else ""
            for f in self.frames
        )
        return re.sub(r"\x1b\[[0-9;?]*[a-zA-Z$]", "", text)


@contextlib.asynccontextmanager
async def opened(url, profile, width=1280, height=800, dark=False):
    """A Page of `url` in a Chromium of its own, whose profile is the folder `profile`."""
    process = subprocess.Popen(
        [
            "nice", "chromium",  # a live axis beside it keeps its time
            "--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0",
            "--enable-unsafe-swiftshader", f"--user-data-dir={profile}", "about:blank",
        ],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        port = await asyncio.to_thread(debugging_port, process)
        async with aiohttp.ClientSession() as session:
            async with session.get(f"http://127.0.0.1:{port}/json/list") as answer:
                target = next(t for t in await answer.json() if t["type"] == "page")
            socket = session.ws_connect(target["webSocketDebuggerUrl"], max_msg_size=0)
            async with socket as connection:
                page = Page(connection)
                listening = asyncio.create_task(page.listen())
                for domain in ("Runtime", "Log", "Network", "Page"):
                    await page.call(f"{domain}.enable")
                await page.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                                deviceScaleFactor=1, mobile=False)  # fmt: skip
                scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
                await page.call("Emulation.setEmulatedMedia", features=[scheme])
                await page.call("Page.navigate", url=url)
                there = "document.readyState === 'complete' && location.href !== 'about:blank'"
                await until(page, there)
                yield page
                listening.cancel()
    finally:
        process.terminate()
        process.wait(20)
        process.stderr.close()


def debugging_port(process):
    for line in process.stderr:
        if found := re.search(r"ws://127\.0\.0\.1:(\d+)/", line):
            return found[1]
    raise RuntimeError("chromium ended")


async def until(page, script, seconds=20):
    for _ in range(10 * seconds):
        if await page.value(script):
            return
        await asyncio.sleep(0.1)
    raise AssertionError(f"did not come: {script}")
