"""Train Mask R-CNN on a set of `metric-tree export`, and register the network for `estimate-scale --detector`.

    python integrations/train_detector/train_detector.py SET --out TRAINED

Requires the extra `train` in a separate environment. The folder TRAINED receives `checkpoint.pt`, from which the
same command continues after an interruption, `learning_curve.png`, `mask_ap.json` (COCO's mask AP of each class on the
validation split), `model.onnx` and `detector.toml`, which `--detector` of `estimate-scale` takes.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import io
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

#: Steps of linear warm-up of the learning rate: Adam's second moments are unreliable in the first steps.
WARMUP_STEPS = 100
#: Maximum norm of the gradient. Early losses of the box regression have outliers.
MAX_GRADIENT_NORM = 5.0
#: Maximum ratio of the longer side of an image in the network to the shorter one, as in torchvision (1333 to 800).
MAX_SIDE_RATIO = 1333 / 800
#: Sides of the anchors of the five levels, as fractions of the short side; torchvision has 32 to 512 for 800 pixels.
ANCHOR_FRACTIONS = (0.04, 0.08, 0.16, 0.32, 0.64)
#: Number of channels of the pyramid and of the heads of the small network, a quarter of torchvision's numbers.
SMALL_CHANNELS = 64
#: Number of regions per image from which the small network learns; torchvision has 512.
SMALL_REGIONS = 64
#: Number of losses in the running mean of the learning curve.
CURVE_WINDOW = 50
#: Version of ONNX's operators that the exporter of torchvision's detection networks supports.
OPSET = 17


class Split:
    """Images and objects of one split of an exported set; crowds are not used for training.

    Parameters
    ----------
    folder : Path
        Folder of the set with `images` and `annotations`.
    name : str
        `train` or `val`.

    Raises
    ------
    SystemExit
        The annotations are missing, or their classes are not 1 to n.
    """

    def __init__(self, folder: Path, name: str) -> None:
        from pycocotools.coco import COCO

        self.images = folder / "images"
        file = folder / "annotations" / f"instances_{name}.json"
        if not file.is_file():
            sys.exit(f"train_detector: {file}: expected the annotations of `metric-tree export`; found no file")
        with contextlib.redirect_stdout(io.StringIO()):
            self.coco = COCO(str(file))
        self.labels = [category["name"] for _, category in sorted(self.coco.cats.items())]
        if sorted(self.coco.cats) != list(range(1, len(self.labels) + 1)):
            sys.exit(f"train_detector: {file}: categories: expected ids from 1 to n; found {sorted(self.coco.cats)}")
        self.ids = sorted(self.coco.imgs)

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, key: tuple[int, bool]) -> tuple[Any, dict[str, Any]]:
        """Return an image (3, H, W), RGB from 0 to 1, and its target; `key` is its index, and whether to mirror it."""
        import torch
        from PIL import Image

        index, is_mirrored = key
        record = self.coco.imgs[self.ids[index]]
        with Image.open(self.images / record["file_name"]) as file:
            pixels = np.asarray(file.convert("RGB"))
        objects = [one for one in self.coco.imgToAnns[self.ids[index]] if not one["iscrowd"] and one["area"] > 0]
        masks = np.zeros((len(objects), *pixels.shape[:2]), dtype=np.uint8)
        for row, one in enumerate(objects):
            masks[row] = self.coco.annToMask(one)
        if is_mirrored:
            pixels, masks = pixels[:, ::-1], masks[:, :, ::-1]
        keep = [row for row in range(len(objects)) if masks[row].any()]
        boxes = np.zeros((len(keep), 4), dtype=np.float32)
        for row, mask in enumerate(masks[keep]):
            (columns,), (rows,) = mask.any(axis=0).nonzero(), mask.any(axis=1).nonzero()
            boxes[row] = columns[0], rows[0], columns[-1] + 1, rows[-1] + 1
        target = {
            "boxes": torch.from_numpy(boxes),
            "labels": torch.tensor([objects[row]["category_id"] for row in keep], dtype=torch.int64),
            "masks": torch.from_numpy(np.ascontiguousarray(masks[keep])),
        }
        return torch.from_numpy(np.ascontiguousarray(pixels.transpose(2, 0, 1))).float() / 255, target


def batches(count: int, batch: int, seed: int, start: int, stop: int) -> Iterator[list[tuple[int, bool]]]:
    """Yield the (index, is_mirrored) of the images of steps `start` to `stop`, which depend only on seed and step."""
    per_epoch = max(count // batch, 1)
    for step in range(start, stop):
        epoch, position = divmod(step, per_epoch)
        generator = np.random.default_rng([seed, epoch])
        order, is_mirrored = generator.permutation(count), generator.random(count) < 0.5
        rows = order[position * batch : (position + 1) * batch]
        yield [(int(row), bool(is_mirrored[row])) for row in rows]


def learning_rate(step: int, steps: int, rate: float) -> float:
    """Return the learning rate of a step: linear warm-up to `rate`, then half a cosine to 0."""
    return rate * min((step + 1) / WARMUP_STEPS, 0.5 * (1 + math.cos(math.pi * step / steps)))


def build_network(backbone: str, classes: int, short_side: int, weights: Path | None) -> Any:
    """Return a Mask R-CNN with random weights, or with the weights of a file whose shapes agree.

    Parameters
    ----------
    backbone : {"resnet50", "resnet18"}
        torchvision's `maskrcnn_resnet50_fpn_v2`, or a small network for small images and CPUs.
    classes : int
        Number of classes without the background.
    short_side : int
        Length in pixels to which the network resizes the shorter side of an image.
    weights : Path, optional
        State of a network as torchvision publishes it; the predictors of other classes are omitted.
    """
    import torch
    from torchvision.models import resnet18
    from torchvision.models.detection import MaskRCNN, backbone_utils, faster_rcnn, mask_rcnn
    from torchvision.models.detection.anchor_utils import AnchorGenerator

    sides = {"min_size": short_side, "max_size": round(short_side * MAX_SIDE_RATIO)}
    if backbone == "resnet50":
        network = mask_rcnn.maskrcnn_resnet50_fpn_v2(
            weights=None, weights_backbone=None, num_classes=classes + 1, **sides
        )
    else:
        layers = {f"layer{k}": str(k - 1) for k in (1, 2, 3, 4)}
        pyramid = backbone_utils.BackboneWithFPN(resnet18(weights=None), layers, [64, 128, 256, 512], SMALL_CHANNELS)
        anchors = tuple((max(round(fraction * short_side), 4),) for fraction in ANCHOR_FRACTIONS)
        network = MaskRCNN(
            pyramid,
            None,
            rpn_anchor_generator=AnchorGenerator(anchors, ((0.5, 1.0, 2.0),) * len(anchors)),
            box_head=faster_rcnn.TwoMLPHead(SMALL_CHANNELS * 7**2, 4 * SMALL_CHANNELS),
            box_predictor=faster_rcnn.FastRCNNPredictor(4 * SMALL_CHANNELS, classes + 1),
            mask_head=mask_rcnn.MaskRCNNHeads(SMALL_CHANNELS, (SMALL_CHANNELS,) * 2, 1),
            mask_predictor=mask_rcnn.MaskRCNNPredictor(SMALL_CHANNELS, SMALL_CHANNELS, classes + 1),
            box_batch_size_per_image=SMALL_REGIONS,
            rpn_pre_nms_top_n_test=200,
            rpn_post_nms_top_n_test=100,
            rpn_pre_nms_top_n_train=400,
            rpn_post_nms_top_n_train=200,
            **sides,
        )
    if weights is not None:
        state, own = torch.load(weights, map_location="cpu", weights_only=True), network.state_dict()
        fitting = {name: value for name, value in state.items() if name in own and own[name].shape == value.shape}
        network.load_state_dict(fitting, strict=False)
        print(f"{weights}: {len(fitting)} of {len(own)} tensors are used", file=sys.stderr)
    return network


def train(network: Any, split: Split, options: argparse.Namespace, checkpoint: Path) -> list[float]:
    """Train up to `options.steps` steps from the last checkpoint, and return the loss of each step."""
    import torch

    device = torch.device(options.device)
    network.to(device).train()
    optimiser = torch.optim.AdamW(network.parameters(), lr=options.rate, weight_decay=options.weight_decay)
    losses: list[float] = []
    if checkpoint.is_file():
        state = torch.load(checkpoint, map_location=device, weights_only=True)
        network.load_state_dict(state["network"])
        optimiser.load_state_dict(state["optimiser"])
        losses = state["losses"]
        print(f"{checkpoint}: continued at step {len(losses)}", file=sys.stderr)
    loader = torch.utils.data.DataLoader(
        split,
        batch_sampler=list(batches(len(split), options.batch, options.seed, len(losses), options.steps)),
        num_workers=options.workers,
        collate_fn=lambda batch: tuple(zip(*batch, strict=True)),
        pin_memory=device.type == "cuda",
    )
    start, durations = time.perf_counter(), []
    for images, targets in shown(loader, "training", options.steps, len(losses)):
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(len(losses), options.steps, options.rate)
        moved = [{key: value.to(device, non_blocking=True) for key, value in one.items()} for one in targets]
        with torch.autocast(device.type, torch.bfloat16, enabled=options.bf16):
            loss = sum(network([image.to(device, non_blocking=True) for image in images], moved).values())
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), MAX_GRADIENT_NORM)
        optimiser.step()
        losses.append(float(loss.detach()))
        if not math.isfinite(losses[-1]):
            sys.exit(f"train_detector: the loss of step {len(losses)} is not finite; use a smaller --rate")
        durations.append(time.perf_counter() - start)
        start = time.perf_counter()
        if len(losses) % options.save_every == 0 or len(losses) == options.steps:
            state = {"network": network.state_dict(), "optimiser": optimiser.state_dict(), "losses": losses}
            torch.save(state, checkpoint.with_suffix(".part"))
            checkpoint.with_suffix(".part").replace(checkpoint)
    if durations:
        print(f"{len(durations)} steps, median {np.median(durations):.3f} s per step", file=sys.stderr)
    return losses


def shown(items: Any, title: str, total: int, done: int = 0) -> Iterator[Any]:
    """Yield the items and show a progress bar with the remaining time."""
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress

    with Progress(*Progress.get_default_columns(), MofNCompleteColumn(), console=Console(stderr=True)) as bars:
        task = bars.add_task(title, total=total, completed=done)
        for item in items:
            yield item
            bars.advance(task)


def detections(network: Any, split: Split, device: str) -> list[dict[str, Any]]:
    """Return the detections of a network in all images of a split in the form of COCO results."""
    import torch
    from pycocotools import mask as coco_mask

    network.to(device).eval()
    results = []
    with torch.inference_mode():
        for index in shown(range(len(split)), "evaluation", len(split)):
            image, _ = split[index, False]
            found = {key: value.cpu().numpy() for key, value in network([image.to(device)])[0].items()}
            for label, score, mask in zip(found["labels"], found["scores"], found["masks"], strict=True):
                runs = coco_mask.encode(np.asfortranarray(mask[0] >= 0.5))
                one = {"image_id": split.ids[index], "category_id": int(label), "score": float(score)}
                results.append({**one, "segmentation": runs})
    return results


def mask_ap(split: Split, results: list[dict[str, Any]]) -> dict[str, dict[str, float | None]]:
    """Return COCO's mask AP and AP50 of each class, and their means as `mean`; None for classes without objects."""
    from pycocotools.cocoeval import COCOeval

    if not results:
        return {name: {"AP": 0.0, "AP50": 0.0} for name in (*split.labels, "mean")}
    with contextlib.redirect_stdout(io.StringIO()):
        evaluation = COCOeval(split.coco, split.coco.loadRes(results), "segm")
        evaluation.evaluate()
        evaluation.accumulate()
    precision = evaluation.eval["precision"][:, :, :, 0, -1]  # (IoU, recall, class) of all areas, 100 detections

    def mean(values: Any) -> float | None:
        return round(float(values[values >= 0].mean()), 4) if (values >= 0).any() else None

    groups = {**{name: precision[:, :, [row]] for row, name in enumerate(split.labels)}, "mean": precision}
    return {name: {"AP": mean(values), "AP50": mean(values[0])} for name, values in groups.items()}


def draw_curve(losses: Sequence[float], ap: dict[str, dict[str, float | None]], file: Path) -> None:
    """Draw the loss of each step with its running mean, and the AP50 of the classes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.plot(range(1, len(losses) + 1), losses, color="0.8", linewidth=0.8, label="loss of a step")
    if len(losses) >= CURVE_WINDOW:
        means = np.convolve(losses, np.full(CURVE_WINDOW, 1 / CURVE_WINDOW), "valid")
        left.plot(range(CURVE_WINDOW, len(losses) + 1), means, label=f"mean of {CURVE_WINDOW} steps")
    left.set(xlabel="step", ylabel="loss", ylim=(0, float(np.quantile(losses, 0.99))))
    left.legend()
    names = [name for name, values in ap.items() if values["AP50"] is not None]
    right.barh(names, [ap[name]["AP50"] or 0.0 for name in names])
    right.set(xlabel="mask AP50 on the validation split", xlim=(0, 1))
    right.invert_yaxis()
    figure.savefig(file, dpi=120)


def export_onnx(network: Any, size: tuple[int, int], file: Path) -> None:
    """Write the network as ONNX for images of any size; `size` is (height, width) of the traced image."""
    import torch

    network.to("cpu").eval()
    torch.onnx.export(
        network,
        ([torch.rand(3, *size)],),
        str(file),
        dynamo=False,
        opset_version=OPSET,
        input_names=["image"],
        output_names=["boxes", "labels", "scores", "masks"],
        dynamic_axes={"image": {1: "height", 2: "width"}},
    )


def registration(model: Path, labels: Sequence[str], title: str) -> str:
    """Return the text of `detector.toml`, the registration of a network next to it."""
    sha256 = hashlib.sha256(model.read_bytes()).hexdigest()
    entries = {"title": title, "file": model.name, "sha256": sha256, "labels": list(labels), "input": "torchvision"}
    lines = [f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in entries.items()]
    return "\n".join(["[detector]", *lines, ""])


def main(words: Sequence[str] | None = None) -> int:
    """Train, evaluate and export; an interrupted training continues at its last checkpoint."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add: Callable[..., Any] = parser.add_argument
    add("set", type=Path, help="folder of `metric-tree export`")
    add("--out", type=Path, required=True, help="folder of the checkpoint and of the results")
    add("--backbone", choices=("resnet50", "resnet18"), default="resnet50", help="resnet18 is for small images")
    add("--weights", type=Path, help="published weights to start from, such as torchvision's of COCO")
    add("--steps", type=int, default=60_000, help="number of steps (default: %(default)s)")
    add("--batch", type=int, default=8, help="images per step (default: %(default)s)")
    add("--short-side", type=int, default=800, help="shorter side in the network in pixels (default: %(default)s)")
    add("--rate", type=float, default=1e-4, help="largest learning rate of AdamW (default: %(default)s)")
    add("--weight-decay", type=float, default=0.05, help="weight decay of AdamW (default: %(default)s)")
    add("--save-every", type=int, default=500, help="steps between checkpoints (default: %(default)s)")
    add("--workers", type=int, default=4, help="processes that read images (default: %(default)s)")
    add("--device", default="cuda", help="cuda or cpu (default: %(default)s)")
    add("--bf16", action="store_true", help="compute in bfloat16 if it is safe")
    add("--seed", type=int, default=0, help="seed of the order of the images and of the weights")
    options = parser.parse_args(words)
    import torch

    torch.manual_seed(options.seed)
    training, validation = Split(options.set, "train"), Split(options.set, "val")
    options.out.mkdir(parents=True, exist_ok=True)
    network = build_network(options.backbone, len(training.labels), options.short_side, options.weights)
    losses = train(network, training, options, options.out / "checkpoint.pt")
    ap = mask_ap(validation, detections(network, validation, options.device))
    (options.out / "mask_ap.json").write_text(json.dumps(ap, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    draw_curve(losses, ap, options.out / "learning_curve.png")
    record = training.coco.imgs[training.ids[0]]
    export_onnx(network, (record["height"], record["width"]), options.out / "model.onnx")
    text = registration(options.out / "model.onnx", training.labels, f"Mask R-CNN {options.backbone} of {options.set}")
    (options.out / "detector.toml").write_text(text, encoding="utf-8")
    for name, values in ap.items():
        print(f"{name}: mask AP {values['AP']}, AP50 {values['AP50']}")
    print(f"estimate-scale SCENE --detector {options.out / 'detector.toml'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
