"""Time-varying BRDF: ages materials over the timeline.  Everything is in `tvbrdf_addon`."""


def glTF2ExportUserExtension() -> object:  # noqa: N802
    """What Blender's glTF exporter asks every add-on for."""
    from .tvbrdf_addon.sharing import GltfHook

    return GltfHook()


def register() -> None:
    from .tvbrdf_addon import addon

    addon.register()


def unregister() -> None:
    from .tvbrdf_addon import addon

    addon.unregister()
