"""Whether windows can open here; asked before a scan with ``--live`` moves anything."""


def need_windows() -> None:
    """Raises `ConfigError`, in one line, where a window could not open."""
    from drivers import ConfigError
    from probe.core.screen import why_no_windows

    if (why := why_no_windows()) is not None:
        raise ConfigError(why)
