"""Time-varying BRDF: ages materials over the timeline.  Everything is in `tvbrdf_addon`."""


def register() -> None:
    from .tvbrdf_addon import addon

    addon.register()


def unregister() -> None:
    from .tvbrdf_addon import addon

    addon.unregister()
