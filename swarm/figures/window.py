"""A window on the screen, through pygame."""

from __future__ import annotations

from typing import Any

import numpy as np


class Window:
    """Shows pictures of one size; raises ModuleNotFoundError where pygame is missing, OSError where the
    display cannot be used. Without a display pygame keeps the pictures to itself, and `visible` is False.
    """

    def __init__(self, width: int, height: int, fps: int) -> None:
        try:
            import pygame
        except ModuleNotFoundError:
            raise ModuleNotFoundError(
                'render_mode="human" needs pygame: pip install "chemoswarm[render]"'
            ) from None
        self.pygame: Any = pygame
        try:
            pygame.display.init()
            self.surface = pygame.display.set_mode((width, height))
        except pygame.error as error:
            raise OSError(f"a window needs a display, got {error}") from None
        self.visible = pygame.display.get_driver() not in ("dummy", "offscreen")
        pygame.display.set_caption("chemoswarm")
        self.clock = pygame.time.Clock()
        self.fps = fps

    def show(self, image: np.ndarray) -> None:
        """Show an image (height, width, 3) uint8, not sooner than the frame rate allows."""
        frame = self.pygame.image.frombuffer(image.tobytes(), image.shape[1::-1], "RGB")
        self.surface.blit(frame, (0, 0))
        self.pygame.event.pump()
        self.pygame.display.flip()
        self.clock.tick(self.fps)

    def close(self) -> None:
        """Close it."""
        self.pygame.display.quit()
