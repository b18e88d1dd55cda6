"""A model as a scene file."""

from __future__ import annotations

TABLES = ("bodies", "joints", "drivers", "forces", "sensors")


def write_scene(model, path):
    """Write a model, which names no meshes, as a scene; returns the path."""
    scene = model.to_scene_dict()
    lines = [
        f"{key} = {toml(value)}" for key, value in scene.items() if not isinstance(value, dict)
    ]
    for key, value in scene.items():
        if key in TABLES:
            for name, entry in value.items():
                lines += [f"[{key}.{name}]", *(f"{k} = {toml(v)}" for k, v in entry.items())]
        elif isinstance(value, dict):
            lines += [f"[{key}]", *(f"{k} = {toml(v)}" for k, v in value.items())]
    path.write_text("\n".join(lines) + "\n")
    return path


def toml(value):
    """A value as TOML writes it, in one line."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(toml(item) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)
